//! A whole sweep as a document: from what the cache knows.

use super::file::Sweep;
use super::front::summarize;
use super::gather::{Album, Gather};
use super::points::{Base, Point};
use super::work::Work;
use crate::engine::Resolution;
use crate::report::{Axis, Document, Fate, Plot, Point as Told};
use crate::store::Store;
use std::collections::{BTreeMap, BTreeSet};
use std::time::{SystemTime, UNIX_EPOCH};

/// What every point of a sweep is, apart from its graph.
pub struct Outline {
    title: String,
    source: String,
    axes: Vec<(String, Vec<String>)>,
    seed: Option<Axis>,
    plot: Plot,
    measure: Vec<String>,
    /// Axis values of each setting.
    values: Vec<Vec<String>>,
    /// Setting, seed, and graph text of each point.
    points: Vec<(usize, Option<String>, String)>,
}

impl Outline {
    /// The outline of `points`; the file called `source` is named `title`.
    pub fn new(
        sweep: &Sweep,
        base: &Base<'_>,
        points: &[Point],
        title: &str,
        source: &str,
    ) -> Self {
        let axes = sweep.axes();
        let given = |point: &Point, name: &str| {
            let own = point.choices.iter().find(|c| c.name == name).map(|c| c.ron.clone());
            let variable =
                || point.graph.vars.iter().find(|v| v.name == name).map(|v| v.text.clone());
            own.or_else(variable).unwrap_or_default()
        };
        let mut values: Vec<Vec<String>> = Vec::new();
        let mut outlined = Vec::with_capacity(points.len());
        for point in points {
            if point.setting == values.len() {
                values.push(axes.iter().map(|(name, _)| given(point, name)).collect());
            }
            let graph = base.with(sweep.set.iter().chain(&point.choices).chain(&point.seed));
            outlined.push((point.setting, point.seed.as_ref().map(|s| s.ron.clone()), graph));
        }
        let seed = sweep.seeds.first().map(|first| Axis {
            name: first.name.clone(),
            values: sweep.seeds.iter().map(|c| c.ron.clone()).collect(),
        });
        let text = |text: &Option<super::Text>| text.as_ref().map(|t| t.text.clone());
        let plot = Plot {
            x: text(&sweep.plot.x).unwrap_or_else(|| "evaluations".into()),
            y: text(&sweep.plot.y).unwrap_or_default(),
            colour: text(&sweep.plot.colour).or_else(|| axes.first().map(|(name, _)| name.clone())),
        };
        let (title, source) = (title.to_owned(), source.to_owned());
        let measure = sweep.measure.iter().map(|m| m.text.clone()).collect();
        Outline { title, source, axes, seed, plot, measure, values, points: outlined }
    }

    /// How a point is called: the values of its axes and its seed.
    pub fn label(&self, point: usize) -> String {
        let (setting, seed, _) = &self.points[point];
        let names = self.axes.iter().map(|(name, _)| name).zip(&self.values[*setting]);
        let seed = self.seed.as_ref().map(|axis| &axis.name).zip(seed.as_ref());
        let all = names.chain(seed).map(|(name, value)| format!("{name}={value}"));
        all.collect::<Vec<_>>().join(" ")
    }

    /// How many points there are.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }
}

/// The node of `node.array`.
pub fn node_of(figure: &str) -> &str {
    figure.split_once('.').map_or(figure, |(node, _)| node)
}

/// The document of a sweep, from what is known of each group of its work.
pub fn document(outline: Outline, work: &Work, known: &[Resolution], store: &Store) -> Document {
    let host = gethostname::gethostname().to_string_lossy().into_owned();
    let mut told: BTreeMap<usize, Told> = BTreeMap::new();
    let mut album = Album::default();
    for (group, known) in work.groups.iter().zip(known) {
        let gather = Gather { store, group, known, host: &host };
        for member in &group.members {
            told.insert(member.point, gather.point(member, &mut album));
        }
    }
    for (point, problem) in &work.hopeless {
        let problem = Some(problem.clone());
        told.insert(*point, Told { fate: Fate::Failed, problem, ..Told::default() });
    }
    let mut points = Vec::with_capacity(outline.points.len());
    for (number, (setting, seed, graph)) in outline.points.into_iter().enumerate() {
        let point = told.remove(&number).unwrap_or_default();
        points.push(Told { setting, seed, graph, ..point });
    }
    let names: BTreeSet<&String> = points.iter().flat_map(|p| p.figures.keys()).collect();
    let mut figures: Vec<String> = names.into_iter().cloned().collect();
    figures.sort_by_key(|figure| outline.measure.iter().position(|m| *m == node_of(figure)));
    let mut plot = outline.plot;
    if !figures.contains(&plot.y) {
        // A node without a number's name, or nothing: its first figure.
        let of = |figure: &&String| figure.starts_with(&format!("{}.", plot.y));
        plot.y = figures.iter().find(of).or(figures.first()).cloned().unwrap_or_default();
    }
    let axis = |(name, values)| Axis { name, values };
    let mut document = Document {
        title: outline.title,
        source: outline.source,
        made: SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs()),
        version: env!("CARGO_PKG_VERSION").into(),
        axes: outline.axes.into_iter().map(axis).collect(),
        seed: outline.seed,
        figures,
        plot,
        points,
        pictures: album.pictures,
        ..Document::default()
    };
    summarize(&mut document, outline.values);
    document
}
