//! Sweep files: what is varied over a graph, what is measured, and within which limits.

use super::reader::Reader;
use crate::graph::syntax::parse;
use crate::graph::tree::{Field, Shape, Value};
use crate::graph::{Code, Diagnostic, Override, Source, Span};
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

/// The fields of `Sweep`.
const FIELDS: [&str; 10] =
    ["graph", "set", "axes", "skip", "seeds", "measure", "cost", "pictures", "plot", "limits"];

/// A sweep file without mistakes of its own; the names in it are checked against the graph later.
#[derive(Debug)]
pub struct Sweep {
    /// The graph file, resolved against the folder of the sweep file.
    pub graph: PathBuf,
    /// What differs from the graph file at every point.
    pub set: Vec<Choice>,
    /// Each block of axes as the alternatives it offers; points are one alternative of each.
    pub blocks: Vec<Vec<Vec<Choice>>>,
    /// Values of one name over which figures are averaged.
    pub seeds: Vec<Choice>,
    /// A point where one of these holds is left out.
    pub skip: Vec<Text>,
    /// Nodes whose numbers are the figures of a point.
    pub measure: Vec<Text>,
    /// Nodes whose making is the cost of a point: what only measures does not count.
    pub cost: Vec<Text>,
    /// Nodes whose pictures a report shows.
    pub pictures: Vec<Text>,
    /// What a report draws first.
    pub plot: PlotChoice,
    /// Limits of the run.
    pub limits: Limits,
}

/// A name with the value it takes.
#[derive(Clone, Debug)]
pub struct Choice {
    /// A variable, or `node.parameter`.
    pub name: String,
    /// The value as RON text.
    pub ron: String,
    /// Where the name stands.
    pub key: Span,
    /// Where the value stands.
    pub value: Span,
}

impl Choice {
    /// The same as a `--set`.
    pub fn as_override(&self) -> Override {
        Override(format!("{}={}", self.name, self.ron))
    }
}

/// A string and its place.
#[derive(Clone, Debug)]
pub struct Text {
    /// The string.
    pub text: String,
    /// Where it stands.
    pub span: Span,
}

/// What a report draws first.
#[derive(Clone, Debug, Default)]
pub struct PlotChoice {
    /// `evaluations` or `cpu_seconds`.
    pub x: Option<Text>,
    /// A figure: `node.number`.
    pub y: Option<Text>,
    /// The axis that colours tell apart.
    pub colour: Option<Text>,
}

/// Limits of a sweep's run; none of them can change a figure.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Node executions side by side. With one, times are each node's own.
    pub jobs: u16,
    /// Memory that running nodes may take together by their own estimates, in gigabytes.
    pub memory: f64,
    /// Size at which the cache drops what is cheapest to make again, in gigabytes.
    pub disk: Option<f64>,
    /// Whether a failed point leaves the others alone.
    pub keep_going: bool,
    /// Whether every execution runs in a pass of its own, so that its time is its own.
    pub apart: bool,
}

impl Default for Limits {
    fn default() -> Self {
        Limits { jobs: 1, memory: 4.0, disk: None, keep_going: true, apart: false }
    }
}

impl Sweep {
    /// Reads a sweep file. `path` is its name in messages; the graph's path starts at `folder`.
    ///
    /// # Errors
    /// All mistakes, in the order of the text.
    pub fn read(text: &str, path: &str, folder: &Path) -> Result<Sweep, Vec<Diagnostic>> {
        let source = Arc::new(Source { path: path.into(), text: text.into() });
        let mut reader = Reader::new();
        let sweep = reader.root(&source, "Sweep").map(|(head, fields)| {
            let mut file = File { head, fields: reader.known_fields("Sweep", fields, &FIELDS) };
            file.sweep(&mut reader, folder)
        });
        let mut mistakes = reader.into_mistakes();
        mistakes.sort_by_key(|m| (m.span.range.start, m.code));
        match sweep {
            Some(sweep) if mistakes.is_empty() => Ok(sweep),
            _ => Err(mistakes),
        }
    }

    /// Every name that axes vary, in the order of the file, with its values, each once.
    pub fn axes(&self) -> Vec<(String, Vec<String>)> {
        let mut axes: Vec<(String, Vec<String>)> = Vec::new();
        for choice in self.blocks.iter().flatten().flatten() {
            let at = axes.iter().position(|(name, _)| *name == choice.name).unwrap_or_else(|| {
                axes.push((choice.name.clone(), Vec::new()));
                axes.len() - 1
            });
            if !axes[at].1.contains(&choice.ron) {
                axes[at].1.push(choice.ron.clone());
            }
        }
        axes
    }
}

/// Whether a text is meant as a sweep file, and not as a graph.
pub fn is_sweep(text: &str) -> bool {
    let source = Arc::new(Source { path: String::new(), text: text.into() });
    let root = parse(&source, 0).value.map(|value| value.shape);
    matches!(root, Some(Shape::Fields(Some(head), _)) if head.text() == "Sweep")
}

/// The fields of a file, taken out one by one.
struct File {
    head: Span,
    fields: BTreeMap<String, Field>,
}

impl File {
    fn take(&mut self, name: &str) -> Option<Value> {
        self.fields.remove(name).map(|field| field.value)
    }

    fn sweep(&mut self, reader: &mut Reader, folder: &Path) -> Sweep {
        let graph = self.take("graph").and_then(|v| reader.text(&v));
        if graph.is_none() {
            reader.mistake(
                Code::Missing,
                &self.head,
                "`graph`, the graph file to sweep, is missing",
            );
        }
        let set = self.take("set").map(|v| reader.choices(&v)).unwrap_or_default();
        let blocks = self.take("axes").map(|v| blocks(reader, v)).unwrap_or_default();
        let seeds = self.take("seeds").map(|v| seeds(reader, &v)).unwrap_or_default();
        let mut texts = |name: &str| self.take(name).map(|v| reader.texts(&v)).unwrap_or_default();
        let (skip, measure) = (texts("skip"), texts("measure"));
        let (cost, pictures) = (texts("cost"), texts("pictures"));
        if measure.is_empty() {
            let message = "`measure`, the nodes whose numbers are the figures, is missing";
            reader.mistake(Code::Missing, &self.head, message);
        }
        if cost.is_empty() {
            let message = "`cost`, the nodes whose making is the cost of a point, is missing";
            reader.mistake(Code::Missing, &self.head, message);
        }
        let plot = self.take("plot").map(|v| plot(reader, v)).unwrap_or_default();
        let limits = self.take("limits").map(|v| limits(reader, v)).unwrap_or_default();
        let graph = plain(&folder.join(graph.map(|g| g.text).unwrap_or_default()));
        once(reader, &blocks, &seeds, &set);
        Sweep { graph, set, blocks, seeds, skip, measure, cost, pictures, plot, limits }
    }
}

/// The path without `x/..`, as a person would write it; links are not looked at.
fn plain(path: &Path) -> PathBuf {
    path.components().fold(PathBuf::new(), |mut plain, part| {
        match (part, plain.components().next_back()) {
            (Component::ParentDir, Some(Component::Normal(_))) => drop(plain.pop()),
            _ => plain.push(part),
        }
        plain
    })
}

/// No name may be given by two blocks, or by a block and by `set` or `seeds`.
fn once(reader: &mut Reader, blocks: &[Vec<Vec<Choice>>], seeds: &[Choice], set: &[Choice]) {
    let mut given: BTreeMap<&str, (usize, &Span)> = BTreeMap::new();
    let all = blocks.iter().map(|block| block.iter().flatten().collect::<Vec<_>>());
    let all = all.chain([seeds.iter().collect(), set.iter().collect()]);
    for (place, choices) in all.enumerate() {
        for choice in choices {
            let (first, span) = *given.entry(&choice.name).or_insert((place, &choice.key));
            if first != place {
                let message = format!("`{}` is given twice", choice.name);
                let twice = Diagnostic::new(Code::Duplicate, choice.key.clone(), message);
                reader.report(twice.label("again").related(span.clone(), "first here"));
            }
        }
    }
}

fn blocks(reader: &mut Reader, value: Value) -> Vec<Vec<Vec<Choice>>> {
    let list = reader.list(value, "`axes: [Grid({...}), Zip({...}), List([{...}])]`");
    list.into_iter().filter_map(|block| alternatives(reader, block)).collect()
}

/// What one block offers.
fn alternatives(reader: &mut Reader, value: Value) -> Option<Vec<Vec<Choice>>> {
    let span = value.span.clone();
    let (kind, mut inside) = match value.shape {
        Shape::Tuple(Some(name), inside) => (name.text().to_owned(), inside),
        Shape::Broken => return None,
        _ => {
            reader.mistake(
                Code::Field,
                &span,
                "expected `Grid({...})`, `Zip({...})` or `List([{...}])`",
            );
            return None;
        }
    };
    let (Some(inside), 0) = (inside.pop(), inside.len()) else {
        reader.mistake(Code::Field, &span, format!("`{kind}` takes one map or list"));
        return None;
    };
    match &*kind {
        "Grid" => {
            let axes = reader.columns(inside);
            let start = vec![Vec::new()];
            Some(axes.into_iter().fold(start, |points, axis| {
                let with = |point: &Vec<Choice>| -> Vec<Vec<Choice>> {
                    let add = |c: &Choice| point.iter().cloned().chain([c.clone()]).collect();
                    axis.iter().map(add).collect()
                };
                points.iter().flat_map(with).collect()
            }))
        }
        "Zip" => {
            let axes = reader.columns(inside);
            let length = axes.iter().map(Vec::len).max().unwrap_or(0);
            for axis in axes.iter().filter(|axis| axis.len() != length) {
                if let Some(first) = axis.first() {
                    let (name, found) = (&first.name, axis.len());
                    let what = format!("`{name}` has {found} values where another has {length}");
                    reader.mistake(Code::Shape, &first.key, what);
                }
            }
            let row = |i: usize| axes.iter().filter_map(|axis| axis.get(i).cloned()).collect();
            Some((0..length).map(row).collect())
        }
        "List" => {
            let points = reader.list(inside, "`List([{...}, {...}])`");
            Some(points.iter().map(|point| reader.choices(point)).collect())
        }
        wrong => {
            let message = format!("there is no kind of axes `{wrong}`");
            reader.unknown(Code::Kind, &span, message, wrong, ["Grid", "Zip", "List"]);
            None
        }
    }
}

fn seeds(reader: &mut Reader, value: &Value) -> Vec<Choice> {
    let mut columns = reader.columns(value.clone());
    if columns.len() > 1 {
        reader.mistake(Code::Shape, &value.span, "`seeds` varies one name");
    }
    if columns.is_empty() { Vec::new() } else { columns.swap_remove(0) }
}

fn plot(reader: &mut Reader, value: Value) -> PlotChoice {
    let Some(fields) = reader.fields(value) else { return PlotChoice::default() };
    let mut fields = reader.known_fields("plot", fields, &["x", "y", "colour"]);
    let mut text = |name: &str| fields.remove(name).and_then(|field| reader.text(&field.value));
    let (x, y, colour) = (text("x"), text("y"), text("colour"));
    const AXES: [&str; 2] = ["evaluations", "cpu_seconds"];
    if let Some(wrong) = x.as_ref().filter(|x| !AXES.contains(&&*x.text)) {
        let message = format!("there is no cost `{}`", wrong.text);
        reader.unknown(Code::Value, &wrong.span, message, &wrong.text, AXES);
    }
    PlotChoice { x, y, colour }
}

fn limits(reader: &mut Reader, value: Value) -> Limits {
    let mut limits = Limits::default();
    let Some(fields) = reader.fields(value) else { return limits };
    let names = ["jobs", "memory", "disk", "keep_going", "apart"];
    let fields = reader.known_fields("limits", fields, &names);
    for (name, field) in fields {
        let value = &field.value;
        match &*name {
            "jobs" => limits.jobs = reader.number(value, 1.0, 1024.0).map_or(1, |n| n as u16),
            "memory" => limits.memory = reader.number(value, 0.0, 1e9).unwrap_or(0.0),
            "disk" => limits.disk = reader.number(value, 0.0, 1e9),
            "keep_going" => limits.keep_going = reader.truth(value),
            _ => limits.apart = reader.truth(value),
        }
    }
    limits
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Sweep, Vec<String>> {
        let told = |d: Diagnostic| format!("{} {}", d.span.place(), d.message);
        Sweep::read(text, "s.ron", Path::new("x"))
            .map_err(|all| all.into_iter().map(told).collect())
    }

    fn told(block: &[Vec<Choice>]) -> Vec<String> {
        let one = |c: &Choice| c.as_override().0;
        block.iter().map(|a| a.iter().map(one).collect::<Vec<_>>().join(" ")).collect()
    }

    #[test]
    fn blocks_offer_alternatives() {
        let sweep = read(
            "Sweep(graph: \"g.ron\", measure: [\"e\"], cost: [\"i\"], axes: [
                Grid({ \"a\": [1, 2], \"b.c\": [(3, 4), x] }), Zip({ \"d\": [5, 6], \"e\": [\"p\", \"q\"] }),
                List([{ \"f\": 7 }, { \"f\": 8, \"g\": 9 }]) ], seeds: { \"seed\": [1, 2, 3] })",
        )
        .unwrap();
        assert_eq!(sweep.graph, Path::new("x/g.ron"));
        assert_eq!(
            told(&sweep.blocks[0]),
            ["a=1 b.c=(3, 4)", "a=1 b.c=x", "a=2 b.c=(3, 4)", "a=2 b.c=x"]
        );
        assert_eq!(told(&sweep.blocks[1]), ["d=5 e=\"p\"", "d=6 e=\"q\""]);
        assert_eq!(told(&sweep.blocks[2]), ["f=7", "f=8 g=9"]);
        assert_eq!(sweep.seeds.len(), 3);
        let axes = sweep.axes();
        assert_eq!(
            axes.iter().map(|(n, v)| (&**n, v.len())).collect::<Vec<_>>(),
            [("a", 2), ("b.c", 2), ("d", 2), ("e", 2), ("f", 2), ("g", 1)]
        );
    }

    #[test]
    fn all_mistakes_are_told_at_once() {
        let found = read(
            "Sweep(grap: \"g.ron\", axes: [Gird({}), Zip({ \"a\": [1, 2], \"b\": [1] }), Grid({ \"a\": [3] })],
  measure: \"e\", plot: (x: \"seconds\"), limits: (jobs: 0, keep_going: 3))",
        )
        .unwrap_err();
        let expected = [
            "s.ron:1:1 `graph`, the graph file to sweep, is missing",
            "s.ron:1:1 `cost`, the nodes whose making is the cost of a point, is missing",
            "s.ron:1:7 `Sweep` has no field `grap`",
            "s.ron:1:29 there is no kind of axes `Gird`",
            "s.ron:1:58 `b` has 1 values where another has 2",
            "s.ron:1:78 `a` is given twice",
            "s.ron:2:27 there is no cost `seconds`",
            "s.ron:2:54 expected a number from 1 to 1024, found `0`",
            "s.ron:2:69 expected `true` or `false`, found `3`",
        ];
        for expected in expected {
            assert!(found.iter().any(|f| f == expected), "{expected} in {found:#?}");
        }
    }
}
