//! What is known without running anything: which executions the records answer, which must run, and
//! which cannot be told yet because their inputs are not known.

use super::EngineError;
use super::bindings::Held;
use super::execution::Plan;
use super::manifest::Manifest;
use crate::graph::Graph;
use crate::store::{Record, Store};
use lightloom_nodes::node::{Digest, Error};
use std::collections::BTreeMap;

/// What is known of an execution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Its inputs are not all known yet.
    Waiting,
    /// Records answer it; nothing to do unless a blob is missing.
    Hit,
    /// It must run.
    Run,
    /// It has run in this process.
    Done,
    /// It failed, or something it needs did.
    Failed,
}

/// The state of all executions of a plan.
pub struct Resolution {
    /// For each execution.
    pub status: Vec<Status>,
    /// For each execution whose inputs are known.
    pub manifest: Vec<Option<Manifest>>,
    /// For each node and item: the artifact, once known.
    pub held: Vec<Vec<Option<Held>>>,
    /// What the executions said that failed themselves.
    pub problems: BTreeMap<usize, String>,
    files: Vec<Option<Vec<Digest>>>,
}

impl Resolution {
    /// Nothing known yet.
    pub fn new(graph: &Graph, plan: &Plan) -> Self {
        Resolution {
            status: vec![Status::Waiting; plan.executions.len()],
            manifest: vec![None; plan.executions.len()],
            held: plan.giver.iter().map(|items| vec![None; items.len()]).collect(),
            problems: BTreeMap::new(),
            files: vec![None; graph.nodes.len()],
        }
    }

    /// Reads the records of every execution whose inputs are known, until no more becomes known.
    ///
    /// # Errors
    /// When a file that a node reads cannot be read.
    pub fn settle(&mut self, graph: &Graph, plan: &Plan, store: &Store) -> Result<(), EngineError> {
        // The order of the graph is not that of the schedule: repeat until nothing changes.
        loop {
            let mut changed = false;
            for e in 0..plan.executions.len() {
                if self.status[e] == Status::Waiting {
                    changed |= self.look_up(graph, plan, store, e)?;
                }
            }
            if !changed {
                return Ok(());
            }
        }
    }

    fn look_up(
        &mut self,
        graph: &Graph,
        plan: &Plan,
        store: &Store,
        e: usize,
    ) -> Result<bool, EngineError> {
        let execution = &plan.executions[e];
        let Some(inputs) = self.inputs(plan, e) else {
            let failed =
                |&(n, item): &(usize, usize)| self.status[plan.giver[n][item]] == Status::Failed;
            let hopeless = execution.inputs.iter().any(|(_, places)| places.iter().any(failed));
            if hopeless {
                self.status[e] = Status::Failed;
            }
            return Ok(hopeless);
        };
        let node = &graph.nodes[execution.node];
        if self.files[execution.node].is_none() {
            let failed = |e: crate::store::StoreError| EngineError::Node {
                name: node.name.clone(),
                kind: node.kind,
                item: String::new(),
                cause: Error::invalid(e.to_string()),
            };
            self.files[execution.node] = Some(Manifest::files(node, store).map_err(failed)?);
        }
        let files = self.files[execution.node].as_deref().unwrap_or_default();
        let manifest = Manifest::new(node, files, &inputs);
        let records = recorded(&manifest, &execution.items, store);
        self.manifest[e] = Some(manifest);
        match records {
            Some(records) => self.know(plan, e, Status::Hit, &records),
            None => self.status[e] = Status::Run,
        }
        Ok(true)
    }

    /// What is bound to each port of an execution; none while any of it is unknown.
    pub fn inputs(&self, plan: &Plan, e: usize) -> Option<Vec<(&'static str, Vec<Held>)>> {
        let port = |(name, places): &(&'static str, Vec<(usize, usize)>)| {
            let held: Option<Vec<Held>> =
                places.iter().map(|&(n, item)| self.held[n][item]).collect();
            held.map(|held| (*name, held))
        };
        plan.executions[e].inputs.iter().map(port).collect()
    }

    /// An execution failed, and said why.
    pub fn fail(&mut self, e: usize, problem: String) {
        self.status[e] = Status::Failed;
        self.problems.insert(e, problem);
    }

    /// The artifacts of an execution are known.
    pub fn know(&mut self, plan: &Plan, e: usize, status: Status, held: &[Held]) {
        let execution = &plan.executions[e];
        self.status[e] = status;
        for (item, held) in execution.items.clone().zip(held) {
            self.held[execution.node][item] = Some(*held);
        }
    }
}

/// The artifacts that records name for every item of an execution, if all are there.
pub fn recorded(
    manifest: &Manifest,
    items: &std::ops::Range<usize>,
    store: &Store,
) -> Option<Vec<Held>> {
    let find = |item: usize| -> Option<Record> { store.record(&manifest.item_key(item, items)) };
    items.clone().map(find).map(|r| r.map(|r| Held { digest: r.output, bytes: r.bytes })).collect()
}
