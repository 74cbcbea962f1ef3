//! What a report shows: points with their figures, costs and pictures.

use serde::Serialize;
use std::collections::BTreeMap;

/// Everything that a report shows; the JSON beside the page is this, without pictures.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Document {
    /// Name of the sweep or graph.
    pub title: String,
    /// The file it was made from, as the user named it.
    pub source: String,
    /// When, in seconds since 1970, UTC.
    pub made: u64,
    /// Version of the program.
    pub version: String,
    /// What was varied, in the order of the file; empty for a single run.
    pub axes: Vec<Axis>,
    /// The variable that was varied for error bars.
    pub seed: Option<Axis>,
    /// Names of all figures, `node.array`, in the order of the graph.
    pub figures: Vec<String>,
    /// What the plot shows first.
    pub plot: Plot,
    /// One for each setting of the axes; points that differ only in their seed share one.
    pub settings: Vec<Setting>,
    /// Every point, in the order of the sweep.
    pub points: Vec<Point>,
    /// The cheapest setting that meets each target.
    pub cheapest: Vec<Cheapest>,
    /// Encoded pictures that points refer to by place.
    #[serde(skip)]
    pub pictures: Vec<Encoded>,
}

/// A varied name with its values as RON text.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Axis {
    /// A variable, or `node.parameter`.
    pub name: String,
    /// In the order of the file, each once.
    pub values: Vec<String>,
}

/// What is drawn against what.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Plot {
    /// `evaluations` or `cpu_seconds`.
    pub x: String,
    /// One of the figures.
    pub y: String,
    /// The axis that colours tell apart; none for a single colour.
    pub colour: Option<String>,
}

/// Mean and sample standard deviation over the seeds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    /// The mean.
    pub mean: f64,
    /// The standard deviation; 0 for a single value.
    pub deviation: f64,
    /// How many values.
    pub count: usize,
}

/// What one setting of the axes gives and costs.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Setting {
    /// Value of each axis, in the order of [`Document::axes`].
    pub values: Vec<String>,
    /// Its points, by place in [`Document::points`].
    pub points: Vec<usize>,
    /// Each figure that at least one of its points has.
    pub figures: BTreeMap<String, Spread>,
    /// Matrix elements that were evaluated; the same on every machine.
    pub evaluations: Option<Spread>,
    /// Processor seconds, from the records of the cache.
    pub cpu_seconds: Option<Spread>,
    /// Whether any of those seconds were measured while something else ran, or for several points at once.
    pub together: bool,
    /// Whether any of them were measured on another host.
    pub other_host: bool,
    /// Whether no other setting is better in the plotted figure at no more evaluations.
    pub front_evaluations: bool,
    /// The same by processor seconds.
    pub front_cpu_seconds: bool,
}

/// What became of a point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fate {
    /// All of it is there.
    Done,
    /// Something failed.
    Failed,
    /// Not run yet, or not finished.
    #[default]
    Missing,
}

/// One point of a sweep.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Point {
    /// Its place in [`Document::settings`].
    pub setting: usize,
    /// Value of the seed.
    pub seed: Option<String>,
    /// What became of it.
    pub fate: Fate,
    /// Why it failed.
    pub problem: Option<String>,
    /// Mean of each array of its measures, `node.array`.
    pub figures: BTreeMap<String, f64>,
    /// Matrix elements that were evaluated for it.
    pub evaluations: Option<u64>,
    /// Processor seconds, from the records of the cache.
    pub cpu_seconds: Option<f64>,
    /// Whether any of those were measured while something else ran, or for several points at once.
    pub together: bool,
    /// Whether any of them were measured on another host.
    pub other_host: bool,
    /// What each node it needs costs, in the order of the graph; the papers' table of stages.
    pub nodes: Vec<NodeCost>,
    /// Name of each picture and its place in [`Document::pictures`].
    pub pictures: Vec<(String, usize)>,
    /// The graph file with the point's values in it.
    pub graph: String,
}

/// What a node costs.
#[derive(Clone, Debug, Default, Serialize)]
pub struct NodeCost {
    /// Its name in the graph.
    pub name: String,
    /// Its type.
    pub kind: String,
    /// Whether it counts for the point's cost; what only measures does not.
    pub counts: bool,
    /// How often it runs.
    pub executions: usize,
    /// Wall clock seconds, added up.
    pub seconds: f64,
    /// Processor seconds, added up.
    pub cpu_seconds: f64,
    /// Most memory that the process held when one of them ended, bytes.
    pub peak_bytes: u64,
    /// Bytes of its artifacts.
    pub bytes: u64,
    /// Matrix elements that it evaluated.
    pub evaluations: u64,
    /// Whether any of the times were measured while something else ran, or for several points at once.
    pub together: bool,
}

/// The cheapest setting whose figure stays within a target.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Cheapest {
    /// The target: 0.05, 0.02, 0.01.
    pub target: f64,
    /// By evaluations: a place in [`Document::settings`]; none when not reached.
    pub evaluations: Option<usize>,
    /// By processor seconds.
    pub cpu_seconds: Option<usize>,
}

/// A picture file.
#[derive(Clone, Debug)]
pub struct Encoded {
    /// Its content.
    pub bytes: Vec<u8>,
    /// `png`, `jpg` ...
    pub extension: String,
}
