//! The command line: what a person sees of a job. It knows the library by its public API only.

mod args;
mod bars;
mod bound;
mod commands;
mod compare;
mod display;
mod document;
mod figures;
mod host;
mod info;
mod job;
mod lines;
mod outcome;
mod passes;
mod progressive;
mod refine;
mod render;
mod topology;
mod values;

use std::process::ExitCode;

use clap::Parser as _;

use args::{Cli, Command};

/// Does what the command line says.
pub(crate) fn main() -> ExitCode {
    // Misuse ends here, with exit code 2 and clap's explanation.
    let Cli { command } = Cli::parse();
    meshmill::storage::share_heap();
    host::raise_open_files();
    host::plan_fault();
    let host = host::host();
    match &command {
        Command::Simplify(args) => commands::simplify(args, &host),
        Command::Progressive(args) => progressive::progressive(args, &host),
        Command::Refine(args) => refine::refine(args, &host),
        Command::Soup(args) => commands::convert(args, meshmill::pipeline::Task::Soup, &host),
        Command::Sort(args) => commands::sort(args, &host),
        Command::Weld(args) => commands::convert(args, meshmill::pipeline::Task::Weld, &host),
        Command::Info(args) => info::info(args, &host),
        Command::Compare(args) => compare::compare(args, &host),
        Command::Render(args) => render::render(args, &host),
        Command::Document(args) => document::document(args, &host),
        Command::Generate(args) => commands::generate(args, &host),
    }
}
