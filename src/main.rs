//! The `meshmill` command.

#[cfg_attr(not(test), expect(dead_code, reason = "the commands that show progress come next"))]
mod cli;

fn main() {}
