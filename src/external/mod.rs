//! The three out-of-core primitives: `sort`, `reduce` (sum by key) and `join` (resolve a reference by key).
