//! What would become of every execution of a plan, told without running anything.

use crate::engine::{Execution, Plan, Resolution, Status};
use crate::store::Store;
use lightloom_nodes::node::Digest;
use std::collections::{BTreeMap, BTreeSet};

/// What would become of an execution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It is reused.
    Hit,
    /// It runs.
    Run,
    /// It runs unless what runs before it gives what it gave before.
    Maybe,
}

/// What the cache has for the executions of a plan.
pub struct Shelf<'a> {
    /// The cache.
    pub store: &'a Store,
    /// The executions.
    pub plan: &'a Plan,
    /// What the records say of them.
    pub known: &'a Resolution,
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
    pub fn bytes(&self, fates: &[Fate]) -> u64 {
        let hits = (0..fates.len()).filter(|&e| fates[e] == Fate::Hit);
        let blobs: BTreeMap<Digest, u64> =
            hits.flat_map(|e| self.blobs(&self.plan.executions[e])).collect();
        let there = |digest: &Digest| self.store.blob_path(digest).exists();
        blobs.iter().filter(|(digest, _)| there(digest)).map(|(_, bytes)| bytes).sum()
    }
}

/// What would become of every execution: as the records say, and what was evicted is made again for whoever needs it.
pub fn fates(shelf: &Shelf<'_>, wanted: &[usize]) -> Vec<Fate> {
    let mut fates: Vec<Fate> = shelf
        .known
        .status
        .iter()
        .map(|status| match status {
            Status::Hit | Status::Done => Fate::Hit,
            Status::Run | Status::Failed => Fate::Run,
            Status::Waiting => Fate::Maybe,
        })
        .collect();
    let evicted: Vec<bool> =
        (0..fates.len()).map(|e| fates[e] == Fate::Hit && shelf.evicted(e)).collect();
    let published: BTreeSet<usize> =
        wanted.iter().flat_map(|&node| shelf.plan.giver[node].iter().copied()).collect();
    let mut changed: Vec<usize> = (0..fates.len()).filter(|&e| fates[e] != Fate::Hit).collect();
    for e in published.into_iter().filter(|&e| evicted[e]) {
        fates[e] = Fate::Run;
        changed.push(e);
    }
    while let Some(e) = changed.pop() {
        for giver in shelf.givers(e).filter(|&g| evicted[g]) {
            let surer =
                fates[giver] == Fate::Hit || (fates[giver], fates[e]) == (Fate::Maybe, Fate::Run);
            if surer {
                fates[giver] = fates[e];
                changed.push(giver);
            }
        }
    }
    fates
}

/// The nodes that must run before it can be told whether an execution must, in the order of the graph.
pub fn blockers(plan: &Plan, known: &Resolution, e: usize) -> BTreeSet<usize> {
    let mut seen = BTreeSet::from([e]);
    let mut open = vec![e];
    let mut found = BTreeSet::new();
    while let Some(e) = open.pop() {
        for &(node, item) in plan.executions[e].inputs.iter().flat_map(|(_, places)| places) {
            let giver = plan.giver[node][item];
            match known.status[giver] {
                Status::Run | Status::Failed => {
                    found.insert(node);
                }
                Status::Waiting if seen.insert(giver) => open.push(giver),
                _ => {}
            }
        }
    }
    found
}
