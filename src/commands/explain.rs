//! `explain`: why a node would run again, or when it last ran.

use super::fates::blockers;
use super::figures;
use super::history::{Comparison, History, compare};
use super::output::{say, say_json};
use super::session::{Failure, Session};
use super::{Common, GraphArgs};
use crate::engine::{Plan, Resolution, Status};
use crate::graph::Axis;
use crate::registry::Registry;
use crate::store::{Record, key_of};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fmt::Write as _;

#[derive(clap::Args)]
pub struct Explain {
    #[command(flatten)]
    graph: GraphArgs,
    /// The node, by its name in the graph.
    node: String,
}

impl Explain {
    pub fn run(&self, common: &Common, registry: &Registry) -> Result<(), Failure> {
        let session = Session::open(common, &self.graph, registry)?;
        let explanation = Explanation::new(&session, &self.node)?;
        if common.json { say_json(&explanation.json()) } else { say(explanation.text()) }
    }
}

/// What is to be said of one node.
struct Explanation {
    name: String,
    kind: &'static str,
    version: u32,
    /// Executions in all, and those that would run.
    executions: usize,
    run: usize,
    verdict: Verdict,
}

enum Verdict {
    /// Records answer every execution.
    Reused(Reused),
    /// The first execution that would run, and the record it is nearest to.
    Runs { which: String, nearest: Option<(Box<Record>, Comparison)> },
    /// Nobody knows before these nodes have run.
    Waits { which: String, nodes: Vec<String> },
}

/// What the records of a reused node say.
struct Reused {
    /// When the last of them was made, in seconds since 1970.
    made: u64,
    seconds: f64,
    bytes: u64,
    /// Artifacts whose bytes are no longer in the cache, of all.
    evicted: usize,
    items: usize,
    notes: Vec<String>,
}

impl Explanation {
    fn new(session: &Session, name: &str) -> Result<Explanation, Failure> {
        let (graph, store) = (&session.graph, &session.store);
        let at = session.node(name)?;
        let (plan, known) = session.resolve(&[at])?;
        let node = &graph.nodes[at];
        let own: Vec<usize> =
            (0..plan.executions.len()).filter(|&e| plan.executions[e].node == at).collect();
        let first = |status| own.iter().copied().find(|&e| known.status[e] == status);
        let verdict = if let Some(e) = first(Status::Run) {
            let execution = &plan.executions[e];
            let manifest =
                known.manifest[e].as_ref().map(|m| m.item(execution.items.start, &execution.items));
            let nearest = manifest.and_then(|manifest| {
                let history = History::read(store, graph);
                let record = Box::new(history.nearest(node.kind, &node.name, &manifest)?.clone());
                let comparison = compare(graph, execution, &record, &manifest);
                Some((record, comparison))
            });
            Verdict::Runs { which: which(node.runs, execution.run), nearest }
        } else if let Some(e) = first(Status::Waiting) {
            let nodes =
                blockers(&plan, &known, e).iter().map(|&n| graph.nodes[n].name.clone()).collect();
            Verdict::Waits { which: which(node.runs, plan.executions[e].run), nodes }
        } else {
            Verdict::Reused(Reused::new(session, &plan, &known, &own))
        };
        let run = own.iter().filter(|&&e| known.status[e] == Status::Run).count();
        let (kind, version, executions) = (node.kind, node.version, own.len());
        Ok(Explanation { name: node.name.clone(), kind, version, executions, run, verdict })
    }

    fn text(&self) -> String {
        let mut out = format!("{}  {} v{}  ", self.name, self.kind, self.version);
        let of_all = match (self.run, self.executions) {
            (_, 1) => String::new(),
            (run, all) => format!(" ({run} of {all} executions)"),
        };
        let comma = |which: &str| {
            if which.is_empty() { String::new() } else { format!(", first for {which}") }
        };
        let _ = match &self.verdict {
            Verdict::Reused(reused) => write!(out, "would be reused{}", reused.text()),
            Verdict::Runs { nearest: None, which } => {
                writeln!(out, "would run{of_all}{}: no {} has run yet", comma(which), self.kind)
            }
            Verdict::Runs { nearest: Some((record, comparison)), which } => {
                let again = if record.name == self.name { " again" } else { "" };
                let head = format!("would run{again}{of_all}{}", comma(which));
                write!(out, "{head}{}", difference(record, comparison))
            }
            Verdict::Waits { nodes, which } => {
                let (nodes, which) = (nodes.join(", "), comma(which));
                writeln!(
                    out,
                    "cannot be told yet{which}\n  it depends on what comes out of {nodes}, to be run first"
                )
            }
        };
        out
    }

    fn json(&self) -> Value {
        let mut value = json!({
            "ok": true, "node": self.name, "kind": self.kind, "version": self.version,
            "executions": self.executions, "run": self.run,
        });
        let verdict = match &self.verdict {
            Verdict::Reused(r) => json!({
                "verdict": "hit", "made": r.made, "seconds": r.seconds, "bytes": r.bytes, "items": r.items,
                "evicted": r.evicted, "notes": r.notes,
            }),
            Verdict::Runs { which, nearest } => {
                let (record, comparison) = nearest.as_ref().map(|(r, c)| (r, c)).unzip();
                json!({
                    "verdict": "run", "first": which,
                    "changes": comparison.map(|c| &c.changes), "unchanged": comparison.map(|c| &c.unchanged),
                    "nearest": record.map(|r| json!({
                        "key": key_of(&r.manifest), "node": r.name, "made": r.made, "seconds": r.seconds, "bytes": r.bytes,
                    })),
                })
            }
            Verdict::Waits { which, nodes } => {
                json!({ "verdict": "maybe", "first": which, "waits_for": nodes })
            }
        };
        if let (Some(value), Value::Object(verdict)) = (value.as_object_mut(), verdict) {
            value.extend(verdict);
        }
        value
    }
}

/// The rest of an explanation for a node that has a nearest record.
fn difference(record: &Record, comparison: &Comparison) -> String {
    let Comparison { changes, unchanged } = comparison;
    let mut out = String::new();
    let _ = match changes.len() {
        // The record of this item is there, that of another one which the execution gives is not.
        0 => writeln!(out, ": another of its items is missing"),
        _ => writeln!(out, ", because:"),
    };
    for change in changes {
        let _ = writeln!(out, "    {}", change.told());
    }
    if !unchanged.is_empty() {
        let _ = writeln!(out, "  unchanged: {}", unchanged.join(", "));
    }
    let _ = writeln!(
        out,
        "  nearest record: {} of {}, {}, {}, {}",
        key_of(&record.manifest).short(),
        record.name,
        figures::moment(record.made),
        figures::duration(record.seconds),
        figures::bytes(record.bytes)
    );
    out
}

impl Reused {
    fn new(session: &Session, plan: &Plan, known: &Resolution, own: &[usize]) -> Reused {
        let store = &session.store;
        let mut all =
            Reused { made: 0, seconds: 0.0, bytes: 0, evicted: 0, items: 0, notes: Vec::new() };
        let mut seen = BTreeSet::new();
        for &e in own {
            let (execution, Some(manifest)) = (&plan.executions[e], &known.manifest[e]) else {
                continue;
            };
            for item in execution.items.clone() {
                let Some(record) = store.record(&key_of(&manifest.item(item, &execution.items)))
                else {
                    continue;
                };
                all.made = all.made.max(record.made);
                all.items += 1;
                all.evicted += usize::from(!store.blob_path(&record.output).exists());
                // Each record of an execution has the seconds of all of it, and equal items are one blob.
                if item == execution.items.start {
                    all.seconds += record.seconds.max(0.0);
                    all.notes
                        .extend(record.notes.into_iter().filter(|note| seen.insert(note.clone())));
                }
                all.bytes += record.bytes;
            }
        }
        all
    }

    fn text(&self) -> String {
        let items = if self.items == 1 { String::new() } else { format!("{} items, ", self.items) };
        let mut out = format!(
            "\n  last run {}, {items}{}, {}\n",
            figures::moment(self.made),
            figures::duration(self.seconds),
            figures::bytes(self.bytes)
        );
        if self.evicted > 0 {
            let (evicted, items) = (self.evicted, self.items);
            let _ = writeln!(
                out,
                "  {evicted} of {items} results were evicted and are made again for whoever needs them"
            );
        }
        for note in &self.notes {
            let _ = writeln!(out, "  note: {note}");
        }
        out
    }
}

/// `frame 5`; empty for the only run of a node.
pub fn which(axis: Axis, run: usize) -> String {
    match axis {
        Axis::Single => String::new(),
        Axis::Frames => format!("frame {run}"),
        Axis::Pairs => format!("pair {run}"),
        Axis::Chunks => format!("chunk {run}"),
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Bench, told};
    use super::*;

    fn explain(bench: &Bench, set: &[&str], node: &str) -> Explanation {
        Explanation::new(&bench.session(set), node).map_err(|f| told(&f)).unwrap()
    }

    #[test]
    fn what_never_ran_and_what_waits() {
        let bench = Bench::new();
        assert_eq!(
            explain(&bench, &[], "still").text(),
            "still  Grey v1  would run: no Grey has run yet\n"
        );
        let text = explain(&bench, &[], "png").text();
        assert_eq!(
            text,
            "png  Png v1  cannot be told yet, first for frame 0\n  it depends on what comes out of frames, to be run first\n"
        );
        assert_eq!(explain(&bench, &[], "png").json()["waits_for"], json!(["frames"]));
    }

    #[test]
    fn what_is_reused_has_a_date_and_notes() {
        let bench = Bench::new();
        bench.run(&[]);
        let text = explain(&bench, &[], "grey").text();
        assert!(text.starts_with("grey  Grey v1  would be reused\n  last run 20"), "{text}");
        assert!(
            text.contains(" UTC, 3 items, ") && text.ends_with("\n  note: one grey\n"),
            "{text}"
        );
        let json = explain(&bench, &[], "grey").json();
        assert_eq!(
            (&json["verdict"], &json["items"], &json["evicted"]),
            (&json!("hit"), &json!(3), &json!(0))
        );
    }

    #[test]
    fn what_differs_is_told_with_its_place() {
        let bench = Bench::new();
        bench.run(&[]);
        let text = explain(&bench, &["grey.size=5"], "grey").text();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[0],
            "grey  Grey v1  would run again (3 of 3 executions), first for frame 0, because:"
        );
        assert_eq!(lines[1], "    param size 4 -> 5  <--set>:1:11");
        assert_eq!(lines[2], "  unchanged: level, round, time");
        assert!(
            lines[3].starts_with("  nearest record: ") && lines[3].contains(" of grey, 20"),
            "{text}"
        );

        // Its own record is preferred to one of `grey`, and one of `grey` to nothing.
        assert!(
            explain(&bench, &["other.level=0.25", "other.size=6"], "other")
                .text()
                .contains("level 0.75 -> 0.25")
        );
        let still = explain(&bench, &[], "still").text();
        assert!(
            still.starts_with("still  Grey v1  would run, because:\n    param level "),
            "{still}"
        );
        assert!(still.contains("input time ") && still.contains(".. -> none\n"), "{still}");
    }

    #[test]
    fn another_input_names_its_node() {
        let bench = Bench::new();
        bench.run(&[]);
        bench.run_nodes(&["level=0.5"], &["grey"]);
        let text = explain(&bench, &["level=0.5"], "png").text();
        assert!(
            text.contains("first for frame 0, because:\n    input image ")
                && text.contains("..  (grey)\n"),
            "{text}"
        );
        let text = explain(&bench, &["level=0.5"], "compare").text();
        assert!(
            text.contains(" (2 of 2 items)  (grey)\n  unchanged: epsilon, reference\n"),
            "{text}"
        );
    }

    #[test]
    fn a_node_there_is_not_is_told_the_nearest() {
        let bench = Bench::new();
        let failure = Explanation::new(&bench.session(&[]), "gray").err().map(|f| told(&f));
        assert_eq!(failure.unwrap(), "the graph has no node `gray`; did you mean `grey`?");
    }
}
