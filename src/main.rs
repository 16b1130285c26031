//! The `meshmill` command.
fn main() {}
