//! What was done before, and how an action differs from it: why something would run again.

use crate::engine::{Execution, Manifest};
use crate::graph::Graph;
use crate::store::{Record, Store};
use lightloom_nodes::node::Digest;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

/// The records of a cache, by kind of node.
pub struct History(BTreeMap<String, Vec<Record>>);

impl History {
    /// Reads the records of all kinds that are in `graph`.
    pub fn read(store: &Store, graph: &Graph) -> Self {
        let kinds: BTreeSet<&str> = graph.nodes.iter().map(|n| n.kind).collect();
        let mut by_kind: BTreeMap<String, Vec<Record>> = BTreeMap::new();
        for (_, record) in store.records().filter(|(_, r)| kinds.contains(&*r.node)) {
            by_kind.entry(record.node.clone()).or_default().push(record);
        }
        History(by_kind)
    }

    fn of(&self, kind: &str) -> &[Record] {
        self.0.get(kind).map_or(&[], |records| records)
    }

    /// The newest record of the node of that kind and name.
    pub fn newest(&self, kind: &str, name: &str) -> Option<&Record> {
        self.of(kind).iter().filter(|r| r.name == name).max_by_key(|r| r.made)
    }

    /// The record that an action of that kind is nearest to: of the node of that name if there is one, then with
    /// the fewest differing lines, then the newest.
    pub fn nearest(&self, kind: &str, name: &str, manifest: &str) -> Option<&Record> {
        let wanted = lines(manifest);
        let distance = |r: &Record| differing(&lines(&r.manifest), &wanted).len();
        self.of(kind).iter().min_by_key(|r| (r.name != name, distance(r), Reverse(r.made)))
    }
}

/// One thing that was different when a record was made.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Change {
    /// `version`, `param`, `file`, `input` or `item`.
    pub what: String,
    /// The parameter, port or file; empty for the others.
    pub name: String,
    /// What it was; none when there was no such thing.
    pub before: Option<String>,
    /// What it is; none when there is no such thing any more.
    pub after: Option<String>,
    /// For a parameter that the graph gives: where.
    pub place: Option<String>,
    /// For a port: the nodes whose artifacts changed.
    pub nodes: Vec<String>,
}

impl Change {
    /// `param rows (10, 10) -> (12, 12)  graphs/x.ron:11:5`, `input lights 9c1f.. -> e07a..  (vpls)`.
    pub fn told(&self) -> String {
        let value = |value: &Option<String>| value.clone().unwrap_or_else(|| "none".into());
        let subject = format!("{} {}", self.what, self.name);
        let mut text =
            format!("{} {} -> {}", subject.trim_end(), value(&self.before), value(&self.after));
        if let Some(place) = &self.place {
            text += &format!("  {place}");
        }
        if !self.nodes.is_empty() {
            text += &format!("  ({})", self.nodes.join(", "));
        }
        text
    }
}

/// What differs between a record and an action of the graph, and the names of what does not.
pub struct Comparison {
    /// In the order of the manifest.
    pub changes: Vec<Change>,
    /// Parameters, ports and files.
    pub unchanged: Vec<String>,
}

/// Compares the `manifest` of one item that `execution` gives with that of a record of its kind.
pub fn compare(
    graph: &Graph,
    execution: &Execution,
    record: &Record,
    manifest: &str,
) -> Comparison {
    let (before, after) = (lines(&record.manifest), lines(manifest));
    let changed = differing(&before, &after);
    let node = &graph.nodes[execution.node];
    let files = node.node.reads();
    let name_of = |what: &str, name: &str| match (what, name.parse::<usize>()) {
        ("file", Ok(k)) => files.get(k).map_or(name.to_owned(), |path| path.display().to_string()),
        _ => name.to_owned(),
    };
    let change = |&(what, name): &(&str, &str)| {
        let value = |lines: &Lines<'_>| find(lines, (what, name)).map(str::to_owned);
        let mut change = Change {
            what: what.into(),
            name: name_of(what, name),
            before: value(&before),
            after: value(&after),
            place: None,
            nodes: Vec::new(),
        };
        match what {
            "param" => {
                change.place = node.given.iter().find(|g| g.name == name).map(|g| g.span.place())
            }
            "file" => [&mut change.before, &mut change.after]
                .into_iter()
                .flatten()
                .for_each(|d| *d = short(d)),
            "input" => {
                let places = execution
                    .inputs
                    .iter()
                    .find(|(port, _)| *port == name)
                    .map_or(&[][..], |(_, p)| p);
                let node_of = |k: usize| places.get(k).map(|&(n, _)| graph.nodes[n].name.as_str());
                tell_input(&mut change, node_of);
            }
            _ => {}
        }
        change
    };
    let same = |key: &&(&str, &str)| !key.1.is_empty() && !changed.contains(key);
    let keys: Vec<(&str, &str)> = after.iter().map(|(key, _)| *key).collect();
    Comparison {
        changes: changed.iter().map(change).collect(),
        unchanged: keys.iter().filter(same).map(|(what, name)| name_of(what, name)).collect(),
    }
}

/// Replaces the digests of a port by what of them matters.
fn tell_input<'g>(change: &mut Change, node_of: impl Fn(usize) -> Option<&'g str>) {
    let digests = |text: &Option<String>| -> Vec<String> {
        text.iter().flat_map(|t| t.split_whitespace()).map(str::to_owned).collect()
    };
    let (before, after) = (digests(&change.before), digests(&change.after));
    let differ: Vec<usize> =
        (0..before.len().max(after.len())).filter(|&k| before.get(k) != after.get(k)).collect();
    for name in differ.iter().filter_map(|&k| node_of(k)) {
        if !change.nodes.iter().any(|n| n == name) {
            change.nodes.push(name.into());
        }
    }
    let several = before.len() > 1 || after.len() > 1;
    let told = |all: &[String]| match (differ.first().and_then(|&k| all.get(k)), all.len()) {
        (_, 0) => None,
        (Some(digest), _) if before.len() == after.len() || !several => Some(short(digest)),
        (_, 1) => Some("1 item".into()),
        (_, count) => Some(format!("{count} items")),
    };
    (change.before, change.after) = (told(&before), told(&after));
    if several && before.len() == after.len() {
        let count = format!(" ({} of {} items)", differ.len(), after.len());
        change.after = change.after.take().map(|text| text + &count);
    }
}

fn short(digest: &str) -> String {
    digest.parse::<Digest>().map_or_else(|_| digest.to_owned(), |d| format!("{}..", d.short()))
}

/// Lines of a manifest: what and name, with the value.
type Lines<'a> = Vec<((&'a str, &'a str), &'a str)>;

fn lines(manifest: &str) -> Lines<'_> {
    Manifest::lines(manifest)
        .into_iter()
        .map(|(label, value)| {
            let (what, name) = label.split_once(' ').unwrap_or((label, ""));
            match what {
                "param" | "file" | "input" => ((what, name.trim_end_matches(" =")), value),
                _ => ((what, ""), name),
            }
        })
        .collect()
}

fn find<'a>(lines: &Lines<'a>, key: (&str, &str)) -> Option<&'a str> {
    lines.iter().find(|(k, _)| *k == key).map(|(_, value)| *value)
}

/// What is not the same in both, in the order of `after`, then what only `before` has.
fn differing<'a>(before: &Lines<'a>, after: &Lines<'a>) -> Vec<(&'a str, &'a str)> {
    let changed = after.iter().filter(|(key, value)| find(before, *key) != Some(value));
    let gone = before.iter().filter(|(key, _)| find(after, *key).is_none());
    changed.chain(gone).map(|(key, _)| *key).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(name: &str, made: u64, manifest: &str) -> Record {
        Record {
            manifest: manifest.into(),
            node: "Grey".into(),
            name: name.into(),
            output: Digest::of(b""),
            bytes: 0,
            seconds: 1.0,
            cpu_seconds: 0.0,
            alone: true,
            host: String::new(),
            evaluations: 0,
            peak_bytes: 0,
            made,
            version: String::new(),
            notes: Vec::new(),
        }
    }

    #[test]
    fn the_nearest_has_the_name_then_few_changes_then_is_new() {
        let old = record("a", 1, "kind Grey\nversion 1\nparam x = 1\nparam y = 1\n");
        let far = record("a", 5, "kind Grey\nversion 1\nparam x = 2\nparam y = 2\n");
        let new = record("a", 2, "kind Grey\nversion 1\nparam x = 2\nparam y = 1\n");
        let other = record("b", 9, "kind Grey\nversion 1\nparam x = 3\nparam y = 1\n");
        let all = vec![old, far.clone(), new.clone(), other.clone()];
        let history = History(BTreeMap::from([("Grey".to_owned(), all)]));
        let manifest = "kind Grey\nversion 1\nparam x = 3\nparam y = 1\n";
        assert_eq!(history.nearest("Grey", "a", manifest), Some(&new));
        assert_eq!(history.nearest("Grey", "c", manifest), Some(&other));
        assert_eq!(history.nearest("Rows", "a", manifest), None);
        assert_eq!(history.newest("Grey", "a"), Some(&far));
    }

    #[test]
    fn lines_that_come_or_go_differ() {
        let before = lines("kind Grey\nversion 1\nparam x = a = b\ninput gone = 1\nitem 0 of 2\n");
        let after = lines("kind Grey\nversion 2\nparam x = a = b\ninput none =\nitem 0 of 2\n");
        assert_eq!(
            differing(&before, &after),
            [("version", ""), ("input", "none"), ("input", "gone")]
        );
        assert_eq!(find(&after, ("param", "x")), Some("a = b"));
        assert_eq!(find(&after, ("input", "none")), Some(""));
    }

    #[test]
    fn inputs_tell_the_first_item_that_changed() {
        let [a, b, c] = ["a", "b", "c"].map(|t| Digest::of(t.as_bytes()));
        let told = |before: &str, after: &str| {
            let mut change = Change {
                what: "input".into(),
                name: "lights".into(),
                before: Some(before.into()),
                after: Some(after.into()),
                place: None,
                nodes: Vec::new(),
            };
            tell_input(&mut change, |k| Some(["sun", "sky", "sky"][k]));
            change.told()
        };
        let (sa, sb, sc) = (a.short(), b.short(), c.short());
        assert_eq!(
            told(&a.to_string(), &b.to_string()),
            format!("input lights {sa}.. -> {sb}..  (sun)")
        );
        let (two, other) = (format!("{a} {b}"), format!("{a} {c}"));
        assert_eq!(
            told(&two, &other),
            format!("input lights {sb}.. -> {sc}.. (1 of 2 items)  (sky)")
        );
        assert_eq!(told(&two, &format!("{a} {b} {c}")), "input lights 2 items -> 3 items  (sky)");
        assert_eq!(told(&b.to_string(), ""), format!("input lights {sb}.. -> none  (sun)"));
        assert_eq!(told("", &a.to_string()), format!("input lights none -> {sa}..  (sun)"));
    }
}
