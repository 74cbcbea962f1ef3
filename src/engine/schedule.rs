//! The scheduler: runs what must run, several executions side by side within a memory limit, frame by
//! frame, and keeps every result as soon as it is there.

use super::EngineError;
use super::bindings::{Bindings, Held};
use super::execution::Plan;
use super::manifest::Manifest;
use super::perform::Ended;
use super::resolve::{Resolution, Status};
use super::summary::{NodeSummary, Summary, peak_bytes};
use crate::graph::Graph;
use crate::store::Store;
use lightloom_nodes::node::Derived;
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// Told of everything that happens, from any thread.
pub trait Progress: Send + Sync {
    /// Node `name` has `total` executions to run in all, of which `hits` need not.
    fn start(&self, node: usize, name: &str, total: usize, hits: usize);
    /// Execution `run` of a node is `done` of `total` steps far.
    fn step(&self, node: usize, run: usize, done: u64, total: u64);
    /// An execution of a node ended well.
    fn end(&self, node: usize, run: usize);
}

/// How a run uses the machine; nothing here can change a result.
pub struct Options {
    /// Executions side by side; each also uses all threads of the pool.
    pub jobs: usize,
    /// Bytes that running nodes may take together, by their own estimates; a node that alone
    /// needs more runs alone.
    pub memory: u64,
    /// Becomes true when the run shall stop.
    pub cancelled: Arc<AtomicBool>,
}

/// Runs whatever the nodes at `wanted` need and the cache does not have, their own blobs included.
///
/// # Errors
/// The first node that failed; cancellation; a failing cache. What was finished is kept in all cases.
pub fn run(
    graph: &Graph,
    plan: &Plan,
    wanted: &[usize],
    store: &Arc<Store>,
    options: &Options,
    progress: &dyn Progress,
) -> Result<(Summary, Resolution), EngineError> {
    let started = Instant::now();
    let mut known = Resolution::new(graph, plan);
    known.settle(graph, plan, store)?;
    let state = State {
        known,
        running: BTreeSet::new(),
        memory: 0,
        failure: None,
        stopped: false,
        nodes: summaries(graph, plan),
        checked: vec![false; plan.executions.len()],
    };
    let derived = Arc::new(Derived::new((options.memory / 4) as usize));
    let shared = Shared {
        graph,
        plan,
        wanted,
        store,
        options,
        progress,
        derived,
        state: Mutex::new(state),
        changed: Condvar::new(),
    };
    shared.announce();
    std::thread::scope(|scope| {
        for _ in 0..options.jobs.max(1) {
            scope.spawn(|| shared.work());
        }
    });
    let mut state = shared.state.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
    if state.stopped {
        options.cancelled.store(false, Ordering::Relaxed);
    }
    if let Some(failure) = state.failure.take() {
        return Err(failure);
    }
    state.nodes.retain(|n| n.executions > 0);
    let summary = Summary {
        nodes: state.nodes,
        seconds: started.elapsed().as_secs_f64(),
        peak_bytes: peak_bytes(),
    };
    Ok((summary, state.known))
}

fn summaries(graph: &Graph, plan: &Plan) -> Vec<NodeSummary> {
    let mut all: Vec<NodeSummary> = graph
        .nodes
        .iter()
        .map(|n| NodeSummary {
            name: n.name.clone(),
            kind: n.kind.into(),
            ..NodeSummary::default()
        })
        .collect();
    plan.executions.iter().for_each(|e| all[e.node].executions += 1);
    all
}

struct State {
    known: Resolution,
    /// Executions under way.
    running: BTreeSet<usize>,
    /// Their estimates, added up.
    memory: u64,
    failure: Option<EngineError>,
    /// Whether a failure, and not the caller, set the flag that stops the run.
    stopped: bool,
    nodes: Vec<NodeSummary>,
    /// Executions whose input blobs were all seen in the cache.
    checked: Vec<bool>,
}

/// What all workers of a run share.
pub(super) struct Shared<'a> {
    pub(super) graph: &'a Graph,
    pub(super) plan: &'a Plan,
    wanted: &'a [usize],
    pub(super) store: &'a Arc<Store>,
    pub(super) options: &'a Options,
    pub(super) progress: &'a dyn Progress,
    pub(super) derived: Arc<Derived>,
    state: Mutex<State>,
    changed: Condvar,
}

/// What a worker does next.
enum Next {
    Run(usize, Manifest, Bindings, u64),
    Wait,
    Stop,
}

impl Shared<'_> {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    fn announce(&self) {
        let state = self.lock();
        for (n, node) in self.graph.nodes.iter().enumerate() {
            let of_node = |e: &usize| self.plan.executions[*e].node == n;
            let all: Vec<usize> = (0..self.plan.executions.len()).filter(of_node).collect();
            let hits = all.iter().filter(|e| state.known.status[**e] == Status::Hit).count();
            if !all.is_empty() {
                self.progress.start(n, &node.name, all.len(), hits);
            }
        }
    }

    fn work(&self) {
        let mut state = self.lock();
        loop {
            match self.next(&mut state) {
                Ok(Next::Stop) => break,
                Ok(Next::Wait) => {
                    // Wakes by itself too: another process may have finished what is waited for.
                    let waited = self.changed.wait_timeout(state, Duration::from_millis(100));
                    state = waited.unwrap_or_else(|poisoned| poisoned.into_inner()).0;
                }
                Ok(Next::Run(e, manifest, bindings, memory)) => {
                    drop(state);
                    let ended = self.execute(e, &manifest, &bindings);
                    state = self.lock();
                    state.running.remove(&e);
                    state.memory -= memory;
                    self.settle(&mut state, e, ended);
                    self.changed.notify_all();
                }
                Err(error) => {
                    state.failure.get_or_insert(error);
                    self.changed.notify_all();
                    break;
                }
            }
        }
    }

    /// Chooses the first execution in the order of the schedule that can start now.
    fn next(&self, state: &mut State) -> Result<Next, EngineError> {
        if state.failure.is_some() {
            return Ok(Next::Stop);
        }
        if self.options.cancelled.load(Ordering::Relaxed) {
            return Err(EngineError::Cancelled);
        }
        state.known.settle(self.graph, self.plan, self.store)?;
        self.want_outputs(state)?;
        let mut open = false;
        for e in 0..self.plan.executions.len() {
            if state.known.status[e] != Status::Run || state.running.contains(&e) {
                open |= state.running.contains(&e) || state.known.status[e] == Status::Waiting;
                continue;
            }
            open = true;
            if !self.inputs_present(state, e)? {
                continue;
            }
            let Some(manifest) = state.known.manifest[e].clone() else { continue };
            // Equal executions give equal results: the second waits for the first one's record.
            let twin = |r: &usize| state.known.manifest[*r].as_ref() == Some(&manifest);
            if state.running.iter().any(twin) {
                continue;
            }
            let Some(inputs) = state.known.inputs(self.plan, e) else { continue };
            let bindings = Bindings::new(Arc::clone(self.store), inputs);
            let memory =
                self.graph.nodes[self.plan.executions[e].node].node.memory(&bindings.sizes());
            if !state.running.is_empty()
                && state.memory.saturating_add(memory) > self.options.memory
            {
                continue;
            }
            state.running.insert(e);
            state.memory += memory;
            return Ok(Next::Run(e, manifest, bindings, memory));
        }
        Ok(if open { Next::Wait } else { Next::Stop })
    }

    /// The blobs of wanted nodes are published: one that is missing is made again.
    fn want_outputs(&self, state: &mut State) -> Result<(), EngineError> {
        for &node in self.wanted {
            for &e in &self.plan.giver[node] {
                if state.known.status[e] == Status::Hit && !state.checked[e] {
                    state.checked[e] = true;
                    self.demand(state, e)?;
                }
            }
        }
        Ok(())
    }

    /// Whether every blob that an execution reads is in the cache; executions that gave one that is
    /// not are set to run again.
    fn inputs_present(&self, state: &mut State, e: usize) -> Result<bool, EngineError> {
        if state.checked[e] {
            return Ok(true);
        }
        let givers: BTreeSet<usize> = self.plan.executions[e]
            .inputs
            .iter()
            .flat_map(|(_, places)| places.iter().map(|&(n, item)| self.plan.giver[n][item]))
            .collect();
        let mut present = true;
        for giver in givers {
            if state.known.status[giver] == Status::Hit {
                self.demand(state, giver)?;
            }
            present &= matches!(state.known.status[giver], Status::Hit | Status::Done);
        }
        state.checked[e] = present;
        Ok(present)
    }

    /// Sets an execution to run again if a blob that its records name is gone or damaged.
    fn demand(&self, state: &mut State, e: usize) -> Result<(), EngineError> {
        let execution = &self.plan.executions[e];
        for item in execution.items.clone() {
            let Some(Held { digest, bytes }) = state.known.held[execution.node][item] else {
                continue;
            };
            if self.store.open_blob(&digest, bytes)?.is_none() {
                state.known.status[e] = Status::Run;
                state.checked[e] = false;
            }
        }
        Ok(())
    }

    fn settle(&self, state: &mut State, e: usize, ended: Result<Ended, EngineError>) {
        let execution = &self.plan.executions[e];
        match ended {
            Ok(Ended { held, seconds, notes, ran }) => {
                state.known.know(self.plan, e, Status::Done, &held);
                let node = &mut state.nodes[execution.node];
                node.ran += usize::from(ran);
                node.seconds += seconds;
                for note in notes {
                    if !node.notes.contains(&note) {
                        node.notes.push(note);
                    }
                }
                self.progress.end(execution.node, execution.run);
            }
            Err(error) => {
                // The first failure stops the rest; what only stopped because of it says nothing new.
                state.stopped |= !self.options.cancelled.swap(true, Ordering::Relaxed);
                if matches!(state.failure, None | Some(EngineError::Cancelled)) {
                    state.failure = Some(error);
                }
            }
        }
    }
}
