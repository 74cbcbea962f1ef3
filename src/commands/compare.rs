//! `compare`: two runs, points of a sweep, or image files: what differs, what it costs, and how far the
//! pictures are apart.

mod figures;
mod side;

use super::Common;
use super::figures as amounts;
use super::output::{say, say_json};
use super::session::{Failure, store};
use crate::engine::{EngineError, write_whole};
use crate::registry::Registry;
use crate::report::page;
use figures::Judged;
use lightloom_nodes::node::Error;
use serde_json::json;
use side::Side;
use std::fmt::Write as _;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Compare {
    /// What to judge: an .exr or .hdr file, a folder of frames, a graph file that was run, or a point of
    /// a sweep as `sweep.ron:7`.
    a: String,
    /// What to judge it against.
    b: String,
    /// For graphs and points: the node whose image counts, in place of the one that is published first.
    #[arg(long)]
    node: Option<String>,
    /// Folder of the page.
    #[arg(long, default_value = "out/compare")]
    out: PathBuf,
}

impl Compare {
    pub fn run(&self, common: &Common, registry: &Registry) -> Result<(), Failure> {
        let store = store(common)?;
        let open = |text: &str| Side::open(text, self.node.as_deref(), common, registry, &store);
        let (a, b) = (open(&self.a)?, open(&self.b)?);
        let judged = Judged::new(&a.images, &b.images).map_err(failed)?;
        let changes = a.changes_to(&b);
        let path = self.out.join("report.html");
        let io = |cause| EngineError::Io { path: path.clone(), cause };
        let document = judged.document(&a, &b);
        let text = page(&document).map_err(|e| io(std::io::Error::other(e.to_string())))?;
        std::fs::create_dir_all(&self.out).map_err(io)?;
        write_whole(&path, text.as_bytes()).map_err(io)?;
        if common.json {
            let figures: serde_json::Map<String, serde_json::Value> =
                judged.figures.iter().map(|(name, value)| (name.clone(), json!(value))).collect();
            return say_json(&json!({
                "ok": true, "changes": changes, "figures": figures, "unknown": judged.unknown,
                "cost": [a.cost, b.cost], "written": [path],
            }));
        }
        let mut out = format!("{} against {}\n", self.a, self.b);
        for change in &changes {
            let _ = writeln!(out, "  differs  {change}");
        }
        if let (Some(a), Some(b)) = (&a.cost, &b.cost) {
            let [from, to] = [a, b].map(|cost| amounts::duration(cost.cpu_seconds));
            let ratio = b.cpu_seconds / a.cpu_seconds.max(1e-9);
            let (e, f) = (a.evaluations, b.evaluations);
            let _ = writeln!(
                out,
                "  cost     {from} -> {to} of processor time (x{ratio:.2}), {e} -> {f} evaluations"
            );
        }
        for (name, value) in &judged.figures {
            let _ = writeln!(out, "  {name:16} {value:.6}");
        }
        for (name, problem) in &judged.unknown {
            let _ = writeln!(out, "  {name:16} unknown: {problem}");
        }
        say(out + &format!("wrote {}\n", path.display()))
    }
}

/// What a metric said that every comparison needs.
fn failed(cause: Error) -> Failure {
    let (name, kind, item) = ("compare".into(), "Compare", String::new());
    Failure::Engine(EngineError::Node { name, kind, item, cause })
}
