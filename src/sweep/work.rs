//! The work of a sweep: its points merged, so that what they share runs once, and counted before it runs.

use super::file::Sweep;
use super::points::Point;
use crate::engine::{Execution, Plan, identities};
use crate::graph::{Graph, Union};
use crate::store::Store;
use lightloom_nodes::node::Digest;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// All work of a sweep.
pub struct Work {
    /// Points that follow the same sequence of frames, merged.
    pub groups: Vec<Group>,
    /// Points that cannot run at all, and why: a file they read is missing.
    pub hopeless: BTreeMap<usize, String>,
    /// Node runs if every point ran by itself.
    pub apart: usize,
    /// Node runs that differ.
    pub distinct: usize,
}

/// Points that are one graph.
pub struct Group {
    /// The union of their graphs.
    pub graph: Graph,
    /// All that they need.
    pub plan: Plan,
    /// What they ask for: measures, pictures and what the cost is about.
    pub wanted: Vec<usize>,
    /// What each execution of the plan is, before anything has run.
    pub identities: Vec<Digest>,
    /// The points.
    pub members: Vec<Member>,
}

/// A point in a group: where its nodes are in the union.
pub struct Member {
    /// Its number in the sweep.
    pub point: usize,
    /// Every node it needs, by its own name, in the order of its graph.
    pub nodes: Vec<(String, usize)>,
    /// Its measures, by name.
    pub measure: Vec<(String, usize)>,
    /// Its pictures, by name.
    pub pictures: Vec<(String, usize)>,
    /// What its cost is about.
    pub cost: Vec<usize>,
}

impl Group {
    /// The executions that the nodes at `wanted` need.
    pub fn needed(&self, wanted: &[usize]) -> BTreeSet<usize> {
        let mut open: Vec<usize> =
            wanted.iter().flat_map(|&n| self.plan.giver[n].iter().copied()).collect();
        let mut found: BTreeSet<usize> = open.iter().copied().collect();
        while let Some(e) = open.pop() {
            let inputs = &self.plan.executions[e].inputs;
            for &(n, item) in inputs.iter().flat_map(|(_, places)| places) {
                let giver = self.plan.giver[n][item];
                if found.insert(giver) {
                    open.push(giver);
                }
            }
        }
        found
    }

    /// The executions that a member needs.
    pub fn executions(&self, member: &Member) -> BTreeSet<usize> {
        self.needed(&member.wanted())
    }

    /// One of its executions.
    pub fn execution(&self, e: usize) -> &Execution {
        &self.plan.executions[e]
    }
}

impl Member {
    /// What it asks for.
    pub fn wanted(&self) -> Vec<usize> {
        let named = self.measure.iter().chain(&self.pictures).map(|(_, n)| *n);
        named.chain(self.cost.iter().copied()).collect()
    }
}

impl Work {
    /// Merges the points of a sweep, and counts.
    ///
    /// # Errors
    /// When the node that makes the sequence of frames fails.
    pub fn new(
        sweep: &Sweep,
        points: Vec<Point>,
        store: &Arc<Store>,
    ) -> Result<Work, lightloom_nodes::node::Error> {
        let mut unions: BTreeMap<String, (Union, Vec<Member>)> = BTreeMap::new();
        let (mut apart, mut distinct) = (0, BTreeSet::<Digest>::new());
        let mut hopeless = BTreeMap::new();
        for (number, point) in points.into_iter().enumerate() {
            let graph = point.graph;
            let find = |name: &str| graph.find(name);
            let named = |texts: &[super::Text]| -> Vec<(String, usize)> {
                texts.iter().filter_map(|t| Some((t.text.clone(), find(&t.text)?))).collect()
            };
            let (measure, pictures) = (named(&sweep.measure), named(&sweep.pictures));
            let cost: Vec<usize> = sweep.cost.iter().filter_map(|t| find(&t.text)).collect();
            let member = Member { point: number, nodes: Vec::new(), measure, pictures, cost };
            let wanted = member.wanted();
            let plan = Plan::new(&graph, &wanted, store)?;
            if let Err(problem) = identities(&graph, &plan, store) {
                hopeless.insert(number, problem.to_string());
                continue;
            }
            apart += plan.executions.len();
            let needed = graph.needed(&wanted);
            let source =
                graph.nodes.iter().zip(&needed).find(|(n, needed)| **needed && n.gives_the_shot());
            let source = source
                .map_or(String::new(), |(n, _)| format!("{} {:?}", n.kind, n.node.canonical()));
            let names: Vec<String> = graph.nodes.iter().map(|n| n.name.clone()).collect();
            let (union, members) = unions.entry(source).or_default();
            let place = union.add(graph, &needed);
            let moved = |named: Vec<(String, usize)>| -> Vec<(String, usize)> {
                named.into_iter().filter_map(|(name, n)| Some((name, place[n]?))).collect()
            };
            members.push(Member {
                point: number,
                nodes: names
                    .into_iter()
                    .zip(&place)
                    .filter_map(|(name, n)| Some((name, (*n)?)))
                    .collect(),
                measure: moved(member.measure),
                pictures: moved(member.pictures),
                cost: member.cost.iter().filter_map(|&n| place[n]).collect(),
            });
        }
        let mut groups = Vec::with_capacity(unions.len());
        for (_, (union, members)) in unions {
            let graph = union.into_graph();
            let wanted: BTreeSet<usize> = members.iter().flat_map(Member::wanted).collect();
            let wanted: Vec<usize> = wanted.into_iter().collect();
            let plan = Plan::new(&graph, &wanted, store)?;
            let identities = identities(&graph, &plan, store)
                .map_err(|e| lightloom_nodes::node::Error::invalid(e.to_string()))?;
            distinct.extend(&identities);
            groups.push(Group { graph, plan, wanted, identities, members });
        }
        Ok(Work { groups, hopeless, apart, distinct: distinct.len() })
    }
}
