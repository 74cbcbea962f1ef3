//! `sweep`: runs a graph at every point of a sweep file, each distinct node run once.

mod progress;
mod session;
mod table;

pub use session::{SweepSession, folder, stem};

use super::Common;
use super::figures;
use super::history::History;
use super::output::{say, say_json};
use super::run::{set_threads, stop_on_interrupt};
use super::session::Failure;
use crate::engine::{self, EngineError, Options, Resolution, Status};
use crate::registry::Registry;
use crate::report::{Document, Fate, csv};
use lightloom_nodes::node::Digest;
use progress::Points;
use serde_json::json;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use table::table;

#[derive(clap::Args)]
pub struct Sweep {
    /// The sweep file.
    file: PathBuf,
    /// Folder of the tables; `out/` and the file's name by default.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Node executions side by side, in place of what the file says.
    #[arg(long, short, value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,
    /// Threads of all nodes together; as many as there are processors by default.
    #[arg(long)]
    threads: Option<u16>,
    /// Counts the work and estimates its time, and runs nothing.
    #[arg(long)]
    plan: bool,
}

impl Sweep {
    pub fn run(&self, common: &Common, registry: &Registry) -> Result<(), Failure> {
        let session = SweepSession::open(common, &self.file, registry)?;
        let known = session.resolve()?;
        let forecast = Forecast::new(&session, &known);
        if self.plan {
            return match common.json {
                true => say_json(&forecast.json()),
                false => say(forecast.text() + ". Nothing was run.\n"),
            };
        }
        if !common.json {
            say(forecast.text() + ".\n")?;
        }
        set_threads(self.threads)?;
        let limits = &session.sweep.limits;
        let options = Options {
            jobs: self.jobs.unwrap_or(limits.jobs).into(),
            memory: (limits.memory * 1e9) as u64,
            keep_going: limits.keep_going,
            apart: limits.apart,
            cancelled: stop_on_interrupt(),
        };
        for (point, problem) in &session.work.hopeless {
            eprintln!("failed: {}: {problem}", session.outline.label(*point));
        }
        let mut ran = 0;
        let mut done = Vec::with_capacity(session.work.groups.len());
        for group in &session.work.groups {
            if options.cancelled.load(Ordering::Relaxed) {
                return Err(EngineError::Cancelled.into());
            }
            let progress = Points::new(group, &session.outline, common.json);
            let (graph, plan) = (&group.graph, &group.plan);
            let (summary, known) =
                engine::run(graph, plan, &group.wanted, &session.store, &options, &progress)?;
            drop(progress);
            ran += summary.ran().0;
            let asked = group.wanted.iter().flat_map(|&n| known.held[n].iter().flatten());
            let pinned: BTreeSet<Digest> = asked.map(|held| held.digest).collect();
            session.store.evict(&pinned)?;
            done.push(known);
        }
        session.store.damage().iter().for_each(|d| eprintln!("repaired: {d}"));
        let folder = folder(self.out.as_ref(), &self.file);
        let document = session.document(&done);
        let written = write_tables(&document, &folder)?;
        let failed = document.points.iter().filter(|p| p.fate == Fate::Failed).count();
        let told = json!({
            "ok": failed == 0, "work": forecast.json(), "ran": ran, "failed": failed,
            "cheapest": document.cheapest, "written": written,
        });
        if !common.json {
            let files: Vec<String> = written.iter().map(|p| p.display().to_string()).collect();
            let (files, file) = (files.join(", "), self.file.display());
            let end = format!(
                "{ran} node runs; wrote {files}. A page for the browser: lightloom report {file}\n"
            );
            say(table(&document) + &end)?;
        }
        match failed {
            0 if common.json => say_json(&told),
            0 => Ok(()),
            _ => {
                let message = format!("{failed} of {} points failed", document.points.len());
                Err(Failure::Points { message, document: told })
            }
        }
    }
}

/// Writes the results as CSV and JSON.
pub fn write_tables(document: &Document, folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let io = |path: &Path| {
        let path = path.to_owned();
        move |cause| EngineError::Io { path, cause }
    };
    std::fs::create_dir_all(folder).map_err(io(folder))?;
    let text = serde_json::to_string_pretty(document)
        .map_err(|e| EngineError::Io { path: folder.into(), cause: e.into() })?;
    let files = [("results.csv", csv(document)), ("results.json", text + "\n")];
    let mut written = Vec::with_capacity(files.len());
    for (name, content) in files {
        let path = folder.join(name);
        engine::write_whole(&path, content.as_bytes()).map_err(io(&path))?;
        written.push(path);
    }
    Ok(written)
}

/// The work to come.
struct Forecast {
    points: usize,
    apart: usize,
    distinct: usize,
    /// Node runs that the cache answers.
    done: usize,
    /// Seconds of the others by their newest records, and whether all have one.
    seconds: (f64, bool),
}

impl Forecast {
    fn new(session: &SweepSession, known: &[Resolution]) -> Self {
        let work = &session.work;
        let (mut done, mut sum, mut complete) = (BTreeSet::new(), 0.0, true);
        for (group, known) in work.groups.iter().zip(known) {
            let history = History::read(&session.store, &group.graph);
            for (e, execution) in group.plan.executions.iter().enumerate() {
                if known.status[e] == Status::Hit {
                    // Groups have executions in common.
                    done.insert(group.identities[e]);
                    continue;
                }
                let node = &group.graph.nodes[execution.node];
                match history.newest(node.kind, &node.name) {
                    Some(record) => sum += record.seconds,
                    None => complete = false,
                }
            }
        }
        Forecast {
            points: session.outline.len(),
            apart: work.apart,
            distinct: work.distinct,
            done: done.len(),
            seconds: (sum, complete),
        }
    }

    fn text(&self) -> String {
        let Forecast { points, apart, distinct, done, .. } = self;
        let shared = apart.saturating_sub(*distinct);
        let left = distinct.saturating_sub(*done);
        let time = match self.seconds {
            _ if left == 0 => String::new(),
            (seconds, true) => format!(", about {}", figures::duration(seconds)),
            (0.0, false) => ", time unknown".into(),
            (seconds, false) => format!(", at least {}", figures::duration(seconds)),
        };
        format!(
            "{points} points: {distinct} node runs in place of {apart} ({shared} shared); {done} done before, {left} to go{time}"
        )
    }

    fn json(&self) -> serde_json::Value {
        json!({
            "points": self.points, "runs_apart": self.apart, "distinct_runs": self.distinct,
            "done_before": self.done, "seconds": self.seconds.0, "estimate_complete": self.seconds.1,
        })
    }
}
