//! Runs a graph file from Rust and says what ran: `cargo run --release --example 1_run_a_graph`.

use lightloom::engine::{self, Options, Plan, Progress, publish};
use lightloom::graph::{Graph, Override};
use lightloom::registry::Registry;
use lightloom::store::Store;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

/// Prints the end of every execution.
struct Ends;

impl Progress for Ends {
    fn start(&self, _: usize, name: &str, total: usize, hits: usize) {
        println!("{name}: {hits} of {total} are in the cache");
    }
    fn step(&self, _: usize, _: usize, _: u64, _: u64) {}
    fn end(&self, _: usize, _: usize) {}
}

fn main() -> Result<(), Box<dyn Error>> {
    let registry = Registry::builtin();
    let folder = Path::new("graphs");
    let text = std::fs::read_to_string(folder.join("quick.ron"))?;
    let small = [Override("size=(96, 54)".into()), Override("columns=60".into())];
    let graph =
        Graph::read(&text, "graphs/quick.ron", folder, &registry, &small).map_err(|mistakes| {
            mistakes.iter().map(|m| m.render(false)).collect::<Vec<_>>().join("\n")
        })?;

    let store = Arc::new(Store::open(Path::new(".lightloom"), None)?);
    let wanted: Vec<usize> = graph.outputs.iter().map(|(_, node)| *node).collect();
    let plan = Plan::new(&graph, &wanted, &store)?;
    let options = Options::default();
    let (summary, known) = engine::run(&graph, &plan, &wanted, &store, &options, &Ends)?;
    for published in publish(&graph, &plan, &known, &store, Path::new("out/example"))? {
        println!("wrote {}", published.path.display());
    }
    let (ran, all) = summary.ran();
    println!("{ran} of {all} executions ran in {:.2} s", summary.seconds);
    Ok(())
}
