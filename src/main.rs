//! The `meshmill` command.

mod cli;

#[global_allocator]
static HEAP: meshmill::storage::HugePages = meshmill::storage::HugePages;

fn main() -> std::process::ExitCode {
    cli::main()
}
