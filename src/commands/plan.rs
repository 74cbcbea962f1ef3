//! `plan`: what a run would do, without running anything.

use super::figures;
use super::history::{History, compare};
use super::session::{Failure, Session};
use super::{Common, GraphArgs};
use crate::engine::{Execution, Plan as Executions, Resolution, Status};
use crate::registry::Registry;
use crate::store::Store;
use lightloom_nodes::node::Digest;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

#[derive(clap::Args)]
pub struct Plan {
    #[command(flatten)]
    graph: GraphArgs,
}

impl Plan {
    pub fn run(&self, common: &Common, registry: &Registry) -> Result<(), Failure> {
        let session = Session::open(common, &self.graph, registry)?;
        let forecast = Forecast::new(&session, registry)?;
        if common.json {
            println!("{}", forecast.json());
        } else {
            print!("{}", forecast.text());
        }
        Ok(())
    }
}

/// What would become of an execution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    /// It is reused.
    Hit,
    /// It runs.
    Run,
    /// It runs unless what runs before it gives what it gave before.
    Maybe,
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
    fn new(session: &Session, registry: &Registry) -> Result<Forecast, Failure> {
        let (graph, store) = (&session.graph, &session.store);
        let wanted = session.outputs();
        let plan = session.plan(&wanted, registry)?;
        let mut known = Resolution::new(graph, &plan);
        known.settle(graph, &plan, store)?;
        let shelf = Shelf { store, plan: &plan, known: &known };
        let fates = fates(&shelf, &wanted);
        let history = History::read(store, graph);
        let usage = store.usage()?;
        let rows = (0..graph.nodes.len()).filter_map(|n| row(session, &shelf, &history, &fates, n)).collect();
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
        let known = self.rows.iter().all(|r| r.bytes.is_some() && r.seconds.iter().all(Option::is_some));
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
            let time = seconds.map_or("time unknown".into(), |s| format!("~{}", figures::duration(s)));
            let _ = writeln!(out, "  {word:5}  {:width$}  {:reasons$}  {time}", row.label(), row.reason);
        }
        if !self.idle.is_empty() {
            let _ = writeln!(out, "  idle   {}: no output needs it", self.idle.join(", "));
        }
        let count = |fate| self.rows.iter().filter(|r| r.fate() == fate).count();
        let (seconds, bytes, known) = self.totals();
        let (run, maybe, all) = (count(Fate::Run), count(Fate::Maybe), self.rows.len());
        let at_least = if known { "about" } else { "at least" };
        let _ = match (run, maybe) {
            (0, 0) => write!(out, "All {all} nodes are reused"),
            (run, 0) => {
                write!(out, "{run} of {all} nodes, {at_least} {}", figures::duration(seconds[0]))
            }
            (run, maybe) => {
                let (sure, more) = (figures::duration(seconds[0]), figures::duration(seconds[1]));
                write!(out, "{run} of {all} nodes, {at_least} {sure}; perhaps {maybe} more, {more}")
            }
        };
        let _ = writeln!(
            out,
            "; +{}, {} reused ({} of {} used). Nothing was run.",
            figures::bytes(bytes),
            figures::bytes(self.reused),
            figures::bytes(self.used),
            figures::bytes(self.quota)
        );
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
fn row(session: &Session, shelf: &Shelf<'_>, history: &History, fates: &[Fate], n: usize) -> Option<Row> {
    let node = &session.graph.nodes[n];
    let executions = &shelf.plan.executions;
    let of = |fate: Fate| (0..fates.len()).filter(move |&e| executions[e].node == n && fates[e] == fate);
    let items = [Fate::Hit, Fate::Run, Fate::Maybe].map(|f| of(f).map(|e| executions[e].items.len()).sum());
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
            Some(line) if line.chars().count() + name.chars().count() < 80 => *line += &format!(" {name}"),
            _ => lines.push(name),
        }
    }
    lines
}

/// What the cache has for the executions of a plan.
struct Shelf<'a> {
    store: &'a Store,
    plan: &'a Executions,
    known: &'a Resolution,
}

impl Shelf<'_> {
    fn blobs<'e>(&'e self, execution: &'e Execution) -> impl Iterator<Item = (Digest, u64)> + 'e {
        let held = execution.items.clone().filter_map(|item| self.known.held[execution.node][item]);
        held.map(|held| (held.digest, held.bytes))
    }

    /// Whether a blob that a record names is no longer there.
    fn evicted(&self, e: usize) -> bool {
        let there = |digest: &Digest, bytes: u64| {
            std::fs::metadata(self.store.blob_path(digest)).is_ok_and(|meta| meta.len() == bytes)
        };
        self.blobs(&self.plan.executions[e]).any(|(digest, bytes)| !there(&digest, bytes))
    }

    /// The executions that give what an execution takes.
    fn givers(&self, e: usize) -> impl Iterator<Item = usize> + '_ {
        let places = self.plan.executions[e].inputs.iter().flat_map(|(_, places)| places);
        places.map(|&(node, item)| self.plan.giver[node][item])
    }

    /// Bytes of the blobs that are reused, each counted once.
    fn bytes(&self, fates: &[Fate]) -> u64 {
        let hits = (0..fates.len()).filter(|&e| fates[e] == Fate::Hit);
        let blobs: BTreeMap<Digest, u64> = hits.flat_map(|e| self.blobs(&self.plan.executions[e])).collect();
        let there = |digest: &Digest| self.store.blob_path(digest).exists();
        blobs.iter().filter(|(digest, _)| there(digest)).map(|(_, bytes)| bytes).sum()
    }
}

/// What would become of every execution: as the records say, and what was evicted is made again for whoever needs it.
fn fates(shelf: &Shelf<'_>, wanted: &[usize]) -> Vec<Fate> {
    let mut fates: Vec<Fate> = shelf
        .known
        .status
        .iter()
        .map(|status| match status {
            Status::Hit | Status::Done => Fate::Hit,
            Status::Run => Fate::Run,
            Status::Waiting => Fate::Maybe,
        })
        .collect();
    let evicted: Vec<bool> = (0..fates.len()).map(|e| fates[e] == Fate::Hit && shelf.evicted(e)).collect();
    let published: BTreeSet<usize> = wanted.iter().flat_map(|&node| shelf.plan.giver[node].iter().copied()).collect();
    let mut changed: Vec<usize> = (0..fates.len()).filter(|&e| fates[e] != Fate::Hit).collect();
    for e in published.into_iter().filter(|&e| evicted[e]) {
        fates[e] = Fate::Run;
        changed.push(e);
    }
    while let Some(e) = changed.pop() {
        for giver in shelf.givers(e).filter(|&g| evicted[g]) {
            let surer = fates[giver] == Fate::Hit || (fates[giver], fates[e]) == (Fate::Maybe, Fate::Run);
            if surer {
                fates[giver] = fates[e];
                changed.push(giver);
            }
        }
    }
    fates
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
        let names: Vec<&str> = blockers(shelf.plan, shelf.known, e).iter().map(|&n| &*graph.nodes[n].name).collect();
        return format!("after {}", names.join(", "));
    };
    let manifest = manifest.item(execution.items.start, &execution.items);
    let Some(record) = history.nearest(node.kind, &node.name, &manifest) else { return "never run".into() };
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

/// The nodes that must run before it can be told whether an execution must, in the order of the graph.
pub fn blockers(plan: &Executions, known: &Resolution, e: usize) -> BTreeSet<usize> {
    let mut seen = BTreeSet::from([e]);
    let mut open = vec![e];
    let mut found = BTreeSet::new();
    while let Some(e) = open.pop() {
        for &(node, item) in plan.executions[e].inputs.iter().flat_map(|(_, places)| places) {
            let giver = plan.giver[node][item];
            match known.status[giver] {
                Status::Run => {
                    found.insert(node);
                }
                Status::Waiting if seen.insert(giver) => open.push(giver),
                _ => {}
            }
        }
    }
    found
}
