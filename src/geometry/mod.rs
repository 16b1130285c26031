//! Pure mathematics on `glam`: no files, no state.
