//! What the cache knows of the points of a group: figures, costs and pictures.

use super::work::{Group, Member};
use crate::engine::{Held, Owner, Resolution, Status, mean, numbers_of};
use crate::report::{Encoded, Fate, NodeCost, Point};
use crate::store::{Record, Store};
use lightloom_nodes::data::{Bytes, Data, Picture, decode};
use lightloom_nodes::node::Digest;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Reads what points of one group gave and cost.
pub struct Gather<'a> {
    /// The cache.
    pub store: &'a Store,
    /// The group.
    pub group: &'a Group,
    /// What is known of its executions.
    pub known: &'a Resolution,
    /// This host: times of others are marked.
    pub host: &'a str,
}

/// Processor seconds and evaluations that the making of `nodes` took; none where a record is missing.
pub fn cost_of(
    group: &Group,
    known: &Resolution,
    store: &Store,
    nodes: &[usize],
) -> Option<(f64, u64)> {
    let gather = Gather { store, group, known, host: "" };
    let needed = group.needed(nodes);
    let records: Vec<Record> =
        needed.into_iter().map(|e| gather.record(e)).collect::<Option<_>>()?;
    let seconds = records.iter().map(|r| r.cpu_seconds).sum();
    Some((seconds, records.iter().map(|r| r.evaluations).sum()))
}

/// Pictures of all points, each once.
#[derive(Default)]
pub struct Album {
    /// The files.
    pub pictures: Vec<Encoded>,
    places: BTreeMap<Digest, usize>,
}

impl Gather<'_> {
    /// One point, but for its setting, its seed and its graph.
    pub fn point(&self, member: &Member, album: &mut Album) -> Point {
        let executions = self.group.executions(member);
        let fate = self.fate(&executions);
        let problem = executions.iter().find_map(|e| self.known.problems.get(e).cloned());
        let mut point = Point { fate, problem, ..Point::default() };
        for (name, node) in &member.measure {
            self.figures(name, *node, &mut point.figures);
        }
        for (name, node) in &member.pictures {
            if let Some(place) = self.picture(*node, album) {
                point.pictures.push((name.clone(), place));
            }
        }
        let costs = self.group.needed(&member.cost);
        let records: Option<Vec<Record>> = costs.iter().map(|&e| self.record(e)).collect();
        if let Some(records) = records {
            point.evaluations = Some(records.iter().map(|r| r.evaluations).sum());
            point.cpu_seconds = Some(records.iter().map(|r| r.cpu_seconds).sum());
            point.together = records.iter().any(|r| !r.alone);
            point.other_host = records.iter().any(|r| r.host != self.host);
        }
        let node = |(name, node): &(String, usize)| self.node(name, *node, &executions, &costs);
        point.nodes = member.nodes.iter().filter_map(node).collect();
        point
    }

    fn fate(&self, executions: &BTreeSet<usize>) -> Fate {
        let is = |wanted: &[Status]| {
            let known = &self.known.status;
            executions.iter().filter(|&&e| wanted.contains(&known[e])).count()
        };
        if is(&[Status::Failed]) > 0 {
            Fate::Failed
        } else if is(&[Status::Hit, Status::Done]) == executions.len() {
            Fate::Done
        } else {
            Fate::Missing
        }
    }

    /// The record of an execution; of one that gives several items, that of the first.
    fn record(&self, e: usize) -> Option<Record> {
        let items = &self.group.execution(e).items;
        let manifest = self.known.manifest[e].as_ref()?;
        self.store.record(&manifest.item_key(items.start, items))
    }

    /// Mean of each array, over all items of the node.
    fn figures(&self, name: &str, node: usize, figures: &mut BTreeMap<String, f64>) {
        let kind = self.group.graph.nodes[node].output;
        let mut arrays: BTreeMap<String, Vec<f64>> = BTreeMap::new();
        for held in self.known.held[node].iter().flatten() {
            let Some(bytes) = self.open(held) else { return };
            let Ok(numbers) = numbers_of(bytes, kind) else { return };
            for number in numbers {
                arrays.entry(number.name).or_default().extend(number.values);
            }
        }
        let means = arrays.into_iter().filter(|(_, values)| !values.is_empty());
        figures.extend(means.map(|(array, values)| (format!("{name}.{array}"), mean(&values))));
    }

    /// A picture, of a sequence the middle one.
    fn picture(&self, node: usize, album: &mut Album) -> Option<usize> {
        let items = &self.known.held[node];
        let held = items.get(items.len() / 2).copied().flatten()?;
        if let Some(&place) = album.places.get(&held.digest) {
            return Some(place);
        }
        debug_assert_eq!(
            self.group.graph.nodes[node].output,
            Picture::TYPE,
            "checked with the names"
        );
        let picture: Picture = decode(self.open(&held)?).ok()?;
        let extension = picture.extension.iter().map(|b| char::from(*b)).collect();
        album.pictures.push(Encoded { bytes: picture.bytes.to_vec(), extension });
        album.places.insert(held.digest, album.pictures.len() - 1);
        Some(album.pictures.len() - 1)
    }

    fn open(&self, held: &Held) -> Option<Bytes> {
        let map = self.store.open_blob(&held.digest, held.bytes).ok()??;
        Some(Arc::new(Owner(map)))
    }

    fn node(
        &self,
        name: &str,
        node: usize,
        executions: &BTreeSet<usize>,
        costs: &BTreeSet<usize>,
    ) -> Option<NodeCost> {
        let own: Vec<usize> =
            executions.iter().copied().filter(|&e| self.group.execution(e).node == node).collect();
        let records: Vec<Record> = own.iter().filter_map(|&e| self.record(e)).collect();
        let held = self.known.held[node].iter().flatten();
        (!records.is_empty()).then(|| NodeCost {
            name: name.to_owned(),
            kind: self.group.graph.nodes[node].kind.to_owned(),
            counts: own.iter().any(|e| costs.contains(e)),
            executions: own.len(),
            seconds: records.iter().map(|r| r.seconds).sum(),
            cpu_seconds: records.iter().map(|r| r.cpu_seconds).sum(),
            peak_bytes: records.iter().map(|r| r.peak_bytes).max().unwrap_or(0),
            bytes: held.map(|h| h.bytes).sum(),
            evaluations: records.iter().map(|r| r.evaluations).sum(),
            together: records.iter().any(|r| !r.alone),
        })
    }
}
