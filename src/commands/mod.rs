//! The command line: one file a command.
//!
//! Exit codes: 0 all is well, 1 a node or the cache failed, 2 the graph or the command line is wrong,
//! 3 nothing matched, 4 stopped by the user.

mod check;
mod clean;
mod compare;
mod explain;
mod fates;
mod figures;
mod graph;
mod history;
mod init;
mod nodes;
mod output;
mod plan;
mod progress;
mod report;
mod run;
mod session;
mod show;
mod sweep;
#[cfg(test)]
mod tests;

pub use session::{Failure, Session};

use crate::registry::Registry;
use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;

/// A node-graph pipeline for many-light and point-based global illumination.
#[derive(Parser)]
#[command(name = "lightloom", version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    common: Common,
}

/// Options of every command.
#[derive(Args, Clone)]
pub struct Common {
    /// Print one JSON document instead of text.
    #[arg(long, global = true)]
    json: bool,
    /// Folder of the cache.
    #[arg(long, global = true, env = "LIGHTLOOM_CACHE", default_value = ".lightloom")]
    cache: PathBuf,
    /// Size at which the cache drops what is cheapest to make again, in gigabytes; 20 by default.
    #[arg(long, global = true, value_name = "GB")]
    quota: Option<f64>,
}

/// A graph file and changes to it.
#[derive(Args, Clone)]
pub struct GraphArgs {
    /// The graph file.
    graph: PathBuf,
    /// Replaces a variable or a parameter for this command: `name=value` or `node.parameter=value`.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
}

#[derive(Subcommand)]
enum Command {
    /// Runs what the cache does not have and publishes the outputs.
    Run(run::Run),
    /// Runs a graph at every point of a sweep file, each distinct node run once.
    Sweep(sweep::Sweep),
    /// Writes a sweep or a run as one page for a browser, with its table as CSV and JSON.
    Report(report::Report),
    /// Compares two runs, points of a sweep, or image files.
    Compare(compare::Compare),
    /// Reads a graph file and reports every mistake.
    Check(check::Check),
    /// Says what a run would do, without running anything.
    Plan(plan::Plan),
    /// Says why a node would run again, or when it last ran.
    Explain(explain::Explain),
    /// Lists the node types, or describes one.
    Nodes(nodes::Nodes),
    /// Draws a graph as DOT or Mermaid.
    Graph(graph::Draw),
    /// Shows where a node's artifact lies, and what is in it.
    Show(show::Show),
    /// Writes the graph that a scene requires.
    Init(init::Init),
    /// Empties the cache.
    Clean(clean::Clean),
}

/// Runs the command line with the node types of `registry`.
pub fn main(registry: Registry) -> ExitCode {
    let cli = Cli::parse();
    let common = &cli.common;
    let ended = match &cli.command {
        Command::Run(c) => c.run(common, &registry),
        Command::Sweep(c) => c.run(common, &registry),
        Command::Report(c) => c.run(common, &registry),
        Command::Compare(c) => c.run(common, &registry),
        Command::Check(c) => c.run(common, &registry),
        Command::Plan(c) => c.run(common, &registry),
        Command::Explain(c) => c.run(common, &registry),
        Command::Nodes(c) => c.run(common, &registry),
        Command::Graph(c) => c.run(common, &registry),
        Command::Show(c) => c.run(common, &registry),
        Command::Init(c) => c.run(common, &registry),
        Command::Clean(c) => c.run(common),
    };
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(common.json),
    }
}
