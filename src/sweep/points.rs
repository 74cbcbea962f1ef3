//! From a sweep file to its points: every combination, without those that are skipped, each as a graph.

use super::condition::Condition;
use super::file::{Choice, Sweep, Text};
use crate::graph::diagnostic::suggest;
use crate::graph::{Code, Diagnostic, Graph, Override, set_value, set_variable};
use crate::registry::Registry;
use std::collections::BTreeMap;
use std::path::Path;

/// One point of a sweep.
pub struct Point {
    /// What its axes take, in the order of the file.
    pub choices: Vec<Choice>,
    /// The value of its seed.
    pub seed: Option<Choice>,
    /// Points that differ only in their seed have the same number.
    pub setting: usize,
    /// Its graph.
    pub graph: Graph,
}

impl Point {
    /// `rows=(5, 5) columns=100 seed=2`.
    pub fn label(&self) -> String {
        let all = self.choices.iter().chain(&self.seed);
        all.map(|c| format!("{}={}", c.name, c.ron)).collect::<Vec<_>>().join(" ")
    }
}

/// The file that a sweep varies.
pub struct Base<'a> {
    /// Its content.
    pub text: &'a str,
    /// Its path.
    pub path: &'a Path,
}

impl Base<'_> {
    fn read(&self, registry: &Registry, overrides: &[Override]) -> Result<Graph, Vec<Diagnostic>> {
        let folder = self.path.parent().unwrap_or(Path::new("."));
        Graph::read(self.text, &self.path.display().to_string(), folder, registry, overrides)
    }

    /// The text of the graph with the values of a point in it; comments stay.
    pub fn with<'c>(&self, choices: impl IntoIterator<Item = &'c Choice>) -> String {
        edited(self.text, choices.into_iter().map(|c| (&*c.name, &*c.ron)))
    }
}

/// The text of a graph with values for names in it, which are variables or `node.parameter`; what it
/// does not have is left out.
pub fn edited<'c>(text: &str, values: impl IntoIterator<Item = (&'c str, &'c str)>) -> String {
    values.into_iter().fold(text.to_owned(), |text, (name, ron)| {
        let edited = match name.split_once('.') {
            Some((node, field)) => set_value(&text, "graph", node, field, ron),
            None => set_variable(&text, "graph", name, ron),
        };
        edited.unwrap_or(text)
    })
}

/// All points of `sweep`.
///
/// # Errors
/// All mistakes: names that the graph does not have, values that do not fit, conditions that are none.
pub fn points(
    sweep: &Sweep,
    base: &Base<'_>,
    registry: &Registry,
) -> Result<Vec<Point>, Vec<Diagnostic>> {
    let mut mistakes = Vec::new();
    let plain = read(base, registry, &sweep.set, &mut mistakes).ok_or_else(|| mistakes.clone())?;
    names(sweep, &plain, &mut mistakes);
    let mut values: BTreeMap<String, String> =
        plain.vars.iter().map(|v| (v.name.clone(), v.text.clone())).collect();
    let varied = sweep.blocks.iter().flatten().flatten().chain(&sweep.seeds);
    for choice in varied {
        values.entry(choice.name.clone()).or_insert_with(|| choice.ron.clone());
    }
    let mut conditions = Vec::new();
    for text in &sweep.skip {
        match Condition::new(text, &values) {
            Ok(condition) => conditions.push(condition),
            Err(mistake) => mistakes.push(*mistake),
        }
    }
    let mut points = Vec::new();
    let mut setting = 0;
    for choices in combinations(&sweep.blocks) {
        let mut values = values.clone();
        values.extend(choices.iter().map(|c| (c.name.clone(), c.ron.clone())));
        let skipped = conditions.iter().any(|c| {
            c.holds(&values).unwrap_or_else(|mistake| {
                add(&mut mistakes, *mistake);
                true
            })
        });
        if skipped {
            continue;
        }
        let seeds = match sweep.seeds.is_empty() {
            true => vec![None],
            false => sweep.seeds.iter().cloned().map(Some).collect(),
        };
        for seed in seeds {
            let given: Vec<Choice> =
                sweep.set.iter().chain(&choices).chain(&seed).cloned().collect();
            if let Some(graph) = read(base, registry, &given, &mut mistakes) {
                points.push(Point { choices: choices.clone(), seed, setting, graph });
            }
        }
        setting += 1;
    }
    if points.is_empty() && mistakes.is_empty() {
        let span = sweep.skip.first().map(|s| s.span.clone());
        let span = span.unwrap_or_else(|| sweep.measure[0].span.clone());
        mistakes.push(Diagnostic::new(Code::Empty, span, "every point is skipped"));
    }
    // Those of the sweep file first, and in its order.
    let place = |m: &Diagnostic| (m.file() == base.path.display().to_string(), m.span.range.start);
    mistakes.sort_by_cached_key(place);
    if mistakes.is_empty() { Ok(points) } else { Err(mistakes) }
}

/// One alternative of each block, in every combination; the last block varies fastest.
fn combinations(blocks: &[Vec<Vec<Choice>>]) -> Vec<Vec<Choice>> {
    blocks.iter().fold(vec![Vec::new()], |points, block| {
        let with = |point: &Vec<Choice>| -> Vec<Vec<Choice>> {
            let join = |more: &Vec<Choice>| point.iter().chain(more).cloned().collect();
            block.iter().map(join).collect()
        };
        points.iter().flat_map(with).collect()
    })
}

/// Reads the graph with values in it. A mistake in a value points at the sweep file, where it stands.
fn read(
    base: &Base<'_>,
    registry: &Registry,
    choices: &[Choice],
    mistakes: &mut Vec<Diagnostic>,
) -> Option<Graph> {
    let overrides: Vec<Override> = choices.iter().map(Choice::as_override).collect();
    let wrong = match base.read(registry, &overrides) {
        Ok(graph) => return Some(graph),
        Err(wrong) => wrong,
    };
    for mut mistake in wrong.into_iter().filter(|m| !m.warning) {
        let at = overrides.iter().position(|o| o.0 == mistake.span.source.text);
        if let Some(choice) = at.map(|k| &choices[k]) {
            let of_name = mistake.span.range.end <= choice.name.len();
            mistake.span = if of_name { choice.key.clone() } else { choice.value.clone() };
            mistake.related.clear();
        }
        add(mistakes, mistake);
    }
    None
}

/// The nodes and figures that a sweep names must be there.
fn names(sweep: &Sweep, graph: &Graph, mistakes: &mut Vec<Diagnostic>) {
    let node = |text: &Text, mistakes: &mut Vec<Diagnostic>| {
        let found = graph.find(&text.text);
        if found.is_none() {
            let help = suggest(&text.text, graph.nodes.iter().map(|n| &*n.name), "nodes");
            let message = format!("the graph has no node `{}`", text.text);
            add(mistakes, Diagnostic::new(Code::Node, text.span.clone(), message).help(help));
        }
        found
    };
    for text in &sweep.cost {
        node(text, mistakes);
    }
    for text in &sweep.measure {
        let Some(found) = node(text, mistakes) else { continue };
        if !graph.nodes[found].figures {
            let message =
                format!("`{}` gives {}, no figures", text.text, graph.nodes[found].output);
            let mistake = Diagnostic::new(Code::Type, text.span.clone(), message);
            add(mistakes, mistake.help("name a node such as Compare".to_owned()));
        }
    }
    for text in &sweep.pictures {
        let Some(found) = node(text, mistakes) else { continue };
        let output = graph.nodes[found].output;
        if output != "Picture" {
            let message = format!("`{}` gives {output}, no picture", text.text);
            let mistake = Diagnostic::new(Code::Type, text.span.clone(), message);
            add(mistakes, mistake.help("name a node such as Png".to_owned()));
        }
    }
    if let Some(y) = &sweep.plot.y {
        let of = y.text.split_once('.').map_or(&*y.text, |(node, _)| node);
        if !sweep.measure.iter().any(|m| m.text == of) {
            let help = suggest(of, sweep.measure.iter().map(|m| &*m.text), "measured are");
            let message = format!("`{}` is no figure of a measured node", y.text);
            add(mistakes, Diagnostic::new(Code::Value, y.span.clone(), message).help(help));
        }
    }
    if let Some(colour) = &sweep.plot.colour {
        let axes = sweep.axes();
        if !axes.iter().any(|(name, _)| *name == colour.text) {
            let help = suggest(&colour.text, axes.iter().map(|(name, _)| &**name), "axes");
            let message = format!("`{}` is not varied", colour.text);
            add(mistakes, Diagnostic::new(Code::Value, colour.span.clone(), message).help(help));
        }
    }
}

/// The same mistake is made at many points, and told once.
fn add(mistakes: &mut Vec<Diagnostic>, mistake: Diagnostic) {
    if !mistakes.contains(&mistake) {
        mistakes.push(mistake);
    }
}
