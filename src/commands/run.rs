//! `run`: runs what the cache does not have and publishes the outputs.

use super::output::{say, say_json};
use super::progress::{Bars, Lines, Silent};
use super::session::{Failure, Session};
use super::{Common, GraphArgs};
use crate::engine::{self, Options, Progress, Published, Summary, publish};
use crate::registry::Registry;
use lightloom_nodes::node::Digest;
use serde_json::json;
use std::collections::BTreeSet;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

#[derive(clap::Args)]
pub struct Run {
    #[command(flatten)]
    graph: GraphArgs,
    /// Folder of the results; `out/` and the graph's name by default.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Node executions side by side.
    #[arg(long, short, default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..))]
    jobs: u16,
    /// Threads of all nodes together; as many as there are processors by default.
    #[arg(long)]
    threads: Option<u16>,
    /// Memory that running nodes may take together by their own estimates, in gigabytes.
    #[arg(long, default_value_t = 4.0, value_name = "GB")]
    memory: f64,
}

impl Run {
    pub fn run(&self, common: &Common, registry: &Registry) -> Result<(), Failure> {
        let session = Session::open(common, &self.graph, registry)?;
        if session.graph.outputs.is_empty() {
            return Err(Failure::Nothing("the graph publishes nothing: name its `outputs`".into()));
        }
        set_threads(self.threads)?;
        let wanted = session.outputs();
        let plan = session.plan(&wanted)?;
        let options = Options {
            jobs: self.jobs.into(),
            memory: (self.memory.max(0.0) * 1e9) as u64,
            cancelled: stop_on_interrupt(),
            ..Options::default()
        };
        let progress: Box<dyn Progress> = match (common.json, std::io::stderr().is_terminal()) {
            (true, _) => Box::new(Silent),
            (false, true) => Box::new(Bars::new()),
            (false, false) => Box::new(Lines::new()),
        };
        let (summary, known) =
            engine::run(&session.graph, &plan, &wanted, &session.store, &options, &*progress)?;
        drop(progress);
        let folder = self.out.clone().unwrap_or_else(|| default_folder(&session.path));
        let published = publish(&session.graph, &plan, &known, &session.store, &folder)?;
        let pinned: BTreeSet<Digest> =
            known.held.iter().flatten().flatten().map(|h| h.digest).collect();
        session.store.evict(&pinned)?;
        session.store.damage().iter().for_each(|d| eprintln!("repaired: {d}"));
        match common.json {
            true => say_json(&as_json(&summary, &folder, &published)),
            false => say(as_text(&summary, &folder, &published)),
        }
    }
}

/// `out/tensor` for `graphs/tensor.ron`.
pub fn default_folder(graph: &Path) -> PathBuf {
    Path::new("out").join(graph.file_stem().unwrap_or(graph.as_os_str()))
}

/// Sets the number of threads of all nodes together, where the user gives it.
pub fn set_threads(threads: Option<u16>) -> Result<(), Failure> {
    let Some(threads) = threads else { return Ok(()) };
    let built = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global();
    built.map_err(|e| Failure::Usage(format!("--threads: {e}")))
}

/// Ctrl-C stops the run after the current steps; a second one ends the program at once.
pub fn stop_on_interrupt() -> Arc<AtomicBool> {
    let cancelled = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&cancelled);
    // Without a handler the program ends at once, which loses no finished result either.
    let _ = ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(4);
        }
        eprintln!("stopping after the current steps; finished results are kept (again: stop now)");
    });
    cancelled
}

fn as_json(summary: &Summary, folder: &Path, published: &[Published]) -> serde_json::Value {
    let files: Vec<_> = published
        .iter()
        .map(|p| json!({ "output": p.output, "path": p.path, "figures": p.figures }))
        .collect();
    json!({ "ok": true, "summary": summary, "folder": folder, "published": files })
}

fn as_text(summary: &Summary, folder: &Path, published: &[Published]) -> String {
    let names = summary.nodes.iter().map(|n| n.name.len()).max().unwrap_or(0);
    let kinds = summary.nodes.iter().map(|n| n.kind.len()).max().unwrap_or(0);
    let mut lines = Vec::new();
    for node in &summary.nodes {
        let reused = node.executions - node.ran;
        let what = match (node.ran, reused) {
            (0, all) => format!("reused {all}"),
            (ran, 0) => format!("ran {ran} in {:.2} s", node.seconds),
            (ran, reused) => format!("ran {ran} in {:.2} s, reused {reused}", node.seconds),
        };
        lines.push(format!("  {:names$}  {:kinds$}  {what}", node.name, node.kind));
        lines.extend(node.notes.iter().map(|note| format!("  {:names$}  note: {note}", "")));
    }
    for p in published.iter().filter(|p| !p.figures.is_empty()) {
        let figures: Vec<String> =
            p.figures.iter().map(|(name, mean)| format!("{name} {mean:.6}")).collect();
        lines.push(format!("  {}: {}", p.output, figures.join(", ")));
    }
    let (ran, all) = summary.ran();
    let (seconds, memory) = (summary.seconds, summary.peak_bytes as f64 * 1e-9);
    let reused = all - ran;
    lines.push(format!("{ran} of {all} executions ran, {reused} reused, in {seconds:.2} s; peak memory {memory:.2} GB"));
    lines.push(format!("{} files in {}\n", published.len(), folder.display()));
    lines.join("\n")
}
