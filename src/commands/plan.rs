//! `plan`: what a run would do, without running anything.

use super::fates::{Fate, Shelf, blockers, fates};
use super::figures;
use super::history::{History, compare};
use super::output::{say, say_json};
use super::session::{Failure, Session};
use super::{Common, GraphArgs};
use crate::engine::Status;
use crate::registry::Registry;
use serde_json::{Value, json};
use std::fmt::Write as _;

#[derive(clap::Args)]
pub struct Plan {
    #[command(flatten)]
    graph: GraphArgs,
}

impl Plan {
    pub fn run(&self, common: &Common, registry: &Registry) -> Result<(), Failure> {
        let session = Session::open(common, &self.graph, registry)?;
        let forecast = Forecast::new(&session)?;
        if common.json { say_json(&forecast.json()) } else { say(forecast.text()) }
    }
}

/// One node's part of a run to come.
struct Row {
    name: String,
    kind: &'static str,
    /// Items by fate: hit, run, maybe.
    items: [usize; 3],
    /// Seconds that the runs and the possible runs take; none without a record to judge by.
    seconds: [Option<f64>; 2],
    /// Bytes that both may add; none without a record to judge by.
    bytes: Option<u64>,
    reason: String,
}

impl Row {
    /// The surest of what may happen.
    fn fate(&self) -> Fate {
        match self.items {
            [_, 0, 0] => Fate::Hit,
            [_, 0, _] => Fate::Maybe,
            _ => Fate::Run,
        }
    }

    /// `dfb`, `dfb[40]`, `dfb[20 of 60]`.
    fn label(&self) -> String {
        let all: usize = self.items.iter().sum();
        let count = match self.fate() {
            Fate::Hit => all,
            Fate::Run => self.items[1],
            Fate::Maybe => self.items[2],
        };
        match (all, count) {
            (1, _) => self.name.clone(),
            (all, count) if all == count => format!("{}[{all}]", self.name),
            (all, count) => format!("{}[{count} of {all}]", self.name),
        }
    }
}

/// A run to come.
struct Forecast {
    rows: Vec<Row>,
    /// Nodes that no output needs.
    idle: Vec<String>,
    /// Bytes in the cache that are reused.
    reused: u64,
    /// Bytes in the cache, and most that may be there.
    used: u64,
    quota: u64,
}

impl Forecast {
    fn new(session: &Session) -> Result<Forecast, Failure> {
        let (graph, store) = (&session.graph, &session.store);
        let wanted = session.outputs();
        let (plan, known) = session.resolve(&wanted)?;
        let shelf = Shelf { store, plan: &plan, known: &known };
        let fates = fates(&shelf, &wanted);
        let history = History::read(store, graph);
        let usage = store.usage()?;
        let rows = (0..graph.nodes.len())
            .filter_map(|n| row(session, &shelf, &history, &fates, n))
            .collect();
        let needed = graph.needed(&wanted);
        let idle = graph.nodes.iter().zip(needed).filter(|(_, needed)| !needed);
        Ok(Forecast {
            rows,
            idle: idle.map(|(node, _)| node.name.clone()).collect(),
            reused: shelf.bytes(&fates),
            used: usage.bytes,
            quota: usage.quota,
        })
    }

    /// Sums of the seconds of runs, of possible runs, of bytes; and whether none of them is unknown.
    fn totals(&self) -> ([f64; 2], u64, bool) {
        let seconds = [0, 1].map(|k| self.rows.iter().filter_map(|r| r.seconds[k]).sum());
        let bytes = self.rows.iter().filter_map(|r| r.bytes).sum();
        let known =
            self.rows.iter().all(|r| r.bytes.is_some() && r.seconds.iter().all(Option::is_some));
        (seconds, bytes, known)
    }

    fn text(&self) -> String {
        let mut out = String::new();
        let hits: Vec<&Row> = self.rows.iter().filter(|r| r.fate() == Fate::Hit).collect();
        if !hits.is_empty() {
            let labels = lines_of(hits.iter().map(|r| r.label()));
            for (k, line) in labels.iter().enumerate() {
                let word = if k == 0 { "hit" } else { "" };
                let _ = writeln!(out, "  {word:5}  {line}");
            }
        }
        let others: Vec<&Row> = self.rows.iter().filter(|r| r.fate() != Fate::Hit).collect();
        let width = others.iter().map(|r| r.label().chars().count()).max().unwrap_or(0);
        let reasons = others.iter().map(|r| r.reason.chars().count()).max().unwrap_or(0);
        for row in &others {
            let (word, seconds) = match row.fate() {
                Fate::Run => ("run", row.seconds[0]),
                _ => ("maybe", row.seconds[1]),
            };
            let time =
                seconds.map_or("time unknown".into(), |s| format!("~{}", figures::duration(s)));
            let _ = writeln!(
                out,
                "  {word:5}  {:width$}  {:reasons$}  {time}",
                row.label(),
                row.reason
            );
        }
        if !self.idle.is_empty() {
            let _ = writeln!(out, "  idle   {}: no output needs it", self.idle.join(", "));
        }
        let count = |fate| self.rows.iter().filter(|r| r.fate() == fate).count();
        let (seconds, bytes, known) = self.totals();
        let (run, maybe, all) = (count(Fate::Run), count(Fate::Maybe), self.rows.len());
        let about = match (known, seconds[0] + seconds[1]) {
            (true, _) => "about ",
            (false, 0.0) => "time unknown",
            _ => "at least ",
        };
        let time = match seconds {
            [0.0, 0.0] if !known => String::new(),
            [sure, 0.0] => figures::duration(sure),
            [sure, more] => {
                format!("{} to {}", figures::duration(sure), figures::duration(sure + more))
            }
        };
        let _ = match (run, maybe) {
            (0, 0) => write!(out, "All {all} nodes are reused"),
            (run, 0) => write!(out, "{run} of {all} nodes, {about}{time}"),
            (run, maybe) => {
                write!(out, "{run} of {all} nodes, perhaps {maybe} more, {about}{time}")
            }
        };
        if bytes > 0 {
            let _ = write!(out, ", +{}", figures::bytes(bytes));
        }
        let [reused, used, quota] = [self.reused, self.used, self.quota].map(figures::bytes);
        let _ = writeln!(out, "; {reused} reused, {used} of {quota} used. Nothing was run.");
        out
    }

    fn json(&self) -> Value {
        let row = |r: &Row| {
            let [hit, run, maybe] = r.items;
            let fate = format!("{:?}", r.fate()).to_lowercase();
            json!({
                "name": r.name, "kind": r.kind, "fate": fate, "items": { "hit": hit, "run": run, "maybe": maybe },
                "seconds": { "run": r.seconds[0], "maybe": r.seconds[1] }, "bytes": r.bytes, "reason": r.reason,
            })
        };
        let (seconds, bytes, known) = self.totals();
        json!({
            "ok": true, "nodes": self.rows.iter().map(row).collect::<Vec<_>>(), "idle": self.idle,
            "seconds": { "run": seconds[0], "maybe": seconds[1] }, "bytes": bytes, "estimates_complete": known,
            "reused_bytes": self.reused, "used_bytes": self.used, "quota_bytes": self.quota,
        })
    }
}

/// What would become of node `n`; none when no output needs it.
fn row(
    session: &Session,
    shelf: &Shelf<'_>,
    history: &History,
    fates: &[Fate],
    n: usize,
) -> Option<Row> {
    let node = &session.graph.nodes[n];
    let executions = &shelf.plan.executions;
    let of =
        |fate: Fate| (0..fates.len()).filter(move |&e| executions[e].node == n && fates[e] == fate);
    let items =
        [Fate::Hit, Fate::Run, Fate::Maybe].map(|f| of(f).map(|e| executions[e].items.len()).sum());
    if items == [0; 3] {
        return None;
    }
    let record = history.newest(node.kind, &node.name);
    let seconds = [Fate::Run, Fate::Maybe].map(|fate| match of(fate).count() {
        0 => Some(0.0),
        runs => record.map(|r| r.seconds.max(0.0) * runs as f64),
    });
    let bytes = match items[1] + items[2] {
        0 => Some(0),
        made => record.map(|r| r.bytes.saturating_mul(made as u64)),
    };
    let first = of(Fate::Run).next().or_else(|| of(Fate::Maybe).next());
    let reason = first.map(|e| reason(session, shelf, history, e, fates[e])).unwrap_or_default();
    Some(Row { name: node.name.clone(), kind: node.kind, items, seconds, bytes, reason })
}

/// Names in lines of about eighty characters.
fn lines_of(names: impl Iterator<Item = String>) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for name in names {
        match lines.last_mut() {
            Some(line) if line.chars().count() + name.chars().count() < 80 => {
                *line += &format!(" {name}")
            }
            _ => lines.push(name),
        }
    }
    lines
}

/// Why an execution runs, in a few words.
fn reason(session: &Session, shelf: &Shelf<'_>, history: &History, e: usize, fate: Fate) -> String {
    let graph = &session.graph;
    let execution = &shelf.plan.executions[e];
    let node = &graph.nodes[execution.node];
    if shelf.known.status[e] == Status::Hit {
        let when = if fate == Fate::Maybe { ", made again if it is needed" } else { "" };
        return format!("its result was evicted{when}");
    }
    let Some(manifest) = &shelf.known.manifest[e] else {
        let names: Vec<&str> =
            blockers(shelf.plan, shelf.known, e).iter().map(|&n| &*graph.nodes[n].name).collect();
        return format!("after {}", names.join(", "));
    };
    let manifest = manifest.item(execution.items.start, &execution.items);
    let Some(record) = history.nearest(node.kind, &node.name, &manifest) else {
        return "never run".into();
    };
    if record.name != node.name {
        return "never run".into();
    }
    let changes = compare(graph, execution, record, &manifest).changes;
    match changes.split_first() {
        Some((first, [])) => first.told(),
        Some((first, rest)) => format!("{} and {} more", first.told(), rest.len()),
        None => "an item of it is missing".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Bench, told};
    use super::*;

    fn forecast(bench: &Bench, set: &[&str]) -> Forecast {
        Forecast::new(&bench.session(set)).map_err(|f| told(&f)).unwrap()
    }

    fn fates_of(forecast: &Forecast) -> String {
        let row = |r: &Row| format!("{:?} {}", r.fate(), r.label());
        forecast.rows.iter().map(row).collect::<Vec<_>>().join(", ")
    }

    #[test]
    fn before_and_after_a_run() {
        let bench = Bench::new();
        let before = forecast(&bench, &[]);
        assert_eq!(
            fates_of(&before),
            "Run frames[3], Maybe grey[3], Maybe other[3], Maybe png[3], Maybe compare[2]"
        );
        let text = before.text();
        assert!(text.contains("maybe  png[3]      after frames  time unknown\n"), "{text}");
        assert!(text.contains("idle   still: no output needs it"), "{text}");
        assert!(
            text.contains(
                "1 of 5 nodes, perhaps 4 more, time unknown; 0 bytes reused, 0 bytes of 20.0 GB"
            ),
            "{text}"
        );

        let summary = bench.run(&[]);
        assert_eq!(summary.ran(), (12, 12));
        let after = forecast(&bench, &[]);
        assert!(after.rows.iter().all(|r| r.fate() == Fate::Hit), "{}", fates_of(&after));
        let text = after.text();
        assert!(
            text.starts_with("  hit    frames[3] grey[3] other[3] png[3] compare[2]\n"),
            "{text}"
        );
        assert!(text.contains("All 5 nodes are reused; "), "{text}");
        assert!(text.ends_with(" of 20.0 GB used. Nothing was run.\n"), "{text}");
        assert_eq!(after.reused, after.used);
        assert_eq!(bench.run(&[]).ran().0, 0);
    }

    #[test]
    fn a_change_runs_a_node_and_perhaps_what_follows() {
        let bench = Bench::new();
        bench.run(&[]);
        let changed = forecast(&bench, &["level=0.5"]);
        assert_eq!(
            fates_of(&changed),
            "Hit frames[3], Run grey[3], Hit other[3], Maybe png[3], Maybe compare[2]"
        );
        let text = changed.text();
        assert!(
            text.contains("run    grey[3]     param level 0.25 -> 0.5  <--set>:1:7  ~"),
            "{text}"
        );
        assert!(text.contains("maybe  png[3]      after grey "), "{text}");
        let json = changed.json();
        let grey = json["nodes"].as_array().unwrap().iter().find(|n| n["name"] == "grey").unwrap();
        assert_eq!((&grey["fate"], &grey["items"]["run"]), (&json!("run"), &json!(3)));
        assert_eq!(json["estimates_complete"], true);
        // 3 greys and 3 pictures, and 2 comparisons.
        let bytes =
            |name: &str| changed.rows.iter().find(|r| r.name == name).unwrap().bytes.unwrap();
        assert_eq!(changed.totals().1, bytes("grey") + bytes("png") + bytes("compare"));
    }

    #[test]
    fn what_was_evicted_runs_where_it_is_needed() {
        let bench = Bench::new();
        bench.run(&[]);
        let remove = |name: &str| {
            let session = bench.session(&[]);
            let records: Vec<_> = session.store.records().filter(|(_, r)| r.name == name).collect();
            records.iter().for_each(|(_, r)| {
                std::fs::remove_file(session.store.blob_path(&r.output)).unwrap()
            });
        };
        // Nobody reads the greys while the pictures are there.
        remove("grey");
        assert!(forecast(&bench, &[]).rows.iter().all(|r| r.fate() == Fate::Hit));
        remove("png");
        let both = forecast(&bench, &[]);
        assert_eq!(
            fates_of(&both),
            "Hit frames[3], Run grey[3], Hit other[3], Run png[3], Hit compare[2]"
        );
        assert!(both.text().contains("its result was evicted"));
        let summary = bench.run(&[]);
        assert_eq!(summary.nodes_that_ran(), ["grey", "png"]);
    }

    #[test]
    fn what_is_evicted_may_be_needed() {
        let bench = Bench::new();
        bench.run(&[]);
        let session = bench.session(&[]);
        for (_, record) in session.store.records().filter(|(_, r)| r.name == "other") {
            std::fs::remove_file(session.store.blob_path(&record.output)).unwrap();
        }
        let changed = forecast(&bench, &["level=0.5"]);
        assert_eq!(
            fates_of(&changed),
            "Hit frames[3], Run grey[3], Maybe other[3], Maybe png[3], Maybe compare[2]"
        );
        assert!(changed.text().contains("evicted, made again if it is needed"));
    }

    #[test]
    fn long_lists_are_broken() {
        let lines = lines_of((0..30).map(|k| format!("node{k:02}")));
        assert_eq!(lines.iter().map(|l| l.split(' ').count()).collect::<Vec<_>>(), [11, 11, 8]);
    }
}
