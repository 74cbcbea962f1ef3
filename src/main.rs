//! The command line.

use lightloom::commands;
use lightloom::registry::Registry;
use std::process::ExitCode;

fn main() -> ExitCode {
    commands::main(Registry::builtin())
}
