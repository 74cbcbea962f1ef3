//! The scheduler: runs what must run, several executions side by side within a memory limit, frame by
//! frame, and keeps every result as soon as it is there.

use super::EngineError;
use super::bindings::{Bindings, Held};
use super::execution::Plan;
use super::meter::Meter;
use super::perform::{Ended, Job};
use super::resolve::{Resolution, Status};
use super::summary::{NodeSummary, Summary, peak_bytes};
use super::together::Together;
use crate::graph::Graph;
use crate::store::Store;
use lightloom_nodes::node::{Derived, Digest};
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
    /// An execution failed, and the run goes on without what needs it.
    fn fail(&self, _node: usize, _run: usize, _problem: &str) {}
}

/// How a run uses the machine; nothing here can change a result.
pub struct Options {
    /// Executions side by side; each also uses all threads of the pool.
    pub jobs: usize,
    /// Bytes that running nodes may take together, by their own estimates; a node that alone
    /// needs more runs alone.
    pub memory: u64,
    /// Whether what does not need a failed node still runs.
    pub keep_going: bool,
    /// Whether every execution runs in a pass of its own, so that its time is its own.
    pub apart: bool,
    /// Becomes true when the run shall stop.
    pub cancelled: Arc<AtomicBool>,
}

impl Default for Options {
    /// Two executions side by side, four gigabytes, and the first failure ends the run.
    fn default() -> Self {
        let (keep_going, apart) = (false, false);
        Options { jobs: 2, memory: 4_000_000_000, keep_going, apart, cancelled: Arc::default() }
    }
}

/// Runs whatever the nodes at `wanted` need and the cache does not have, their own blobs included.
///
/// # Errors
/// The first node that failed, unless the run keeps going and says so in [`Resolution::problems`];
/// cancellation; a failing cache. What was finished is kept in all cases.
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
        written: 0,
    };
    let derived = Arc::new(Derived::new((options.memory / 4) as usize));
    let together = if options.apart { Together::none(plan) } else { Together::new(graph, plan) };
    let shared = Shared {
        graph,
        plan,
        wanted,
        store,
        options,
        progress,
        derived,
        together,
        meter: Meter::new(),
        host: gethostname::gethostname().to_string_lossy().into_owned(),
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
    /// Bytes of blobs made since there was last made room.
    written: u64,
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
    pub(super) meter: Meter,
    pub(super) host: String,
    together: Together,
    state: Mutex<State>,
    changed: Condvar,
}

/// What a worker does next.
enum Next {
    /// Executions that share a pass, and their estimates, added up.
    Run(Vec<Job>, u64),
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
                Ok(Next::Run(jobs, memory)) => {
                    drop(state);
                    let ended = self.execute(&jobs);
                    state = self.lock();
                    state.memory -= memory;
                    for (job, ended) in jobs.iter().zip(ended) {
                        state.running.remove(&job.e);
                        self.settle(&mut state, job.e, ended);
                    }
                    self.changed.notify_all();
                    if let Some(pinned) = self.room_is_due(&mut state) {
                        drop(state);
                        let evicted = self.store.evict(&pinned);
                        state = self.lock();
                        if let Err(error) = evicted {
                            state.failure.get_or_insert(error.into());
                        }
                    }
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
        let mut deferred = None;
        for e in 0..self.plan.executions.len() {
            if state.known.status[e] != Status::Run || state.running.contains(&e) {
                open |= state.running.contains(&e) || state.known.status[e] == Status::Waiting;
                continue;
            }
            open = true;
            if !self.may_start(state, e)? {
                continue;
            }
            // Others may soon be ready to share the pass.
            if self.together.with(e).any(|other| state.known.status[other] == Status::Waiting) {
                deferred.get_or_insert(e);
                continue;
            }
            if let Some(next) = self.pass(state, e)? {
                return Ok(next);
            }
        }
        if let Some(e) = deferred.filter(|_| state.running.is_empty())
            && let Some(next) = self.pass(state, e)?
        {
            return Ok(next);
        }
        Ok(if open { Next::Wait } else { Next::Stop })
    }

    /// Whether all that an execution reads is there, and no equal one is under way: equal executions
    /// give equal results, and the second takes the first one's.
    fn may_start(&self, state: &mut State, e: usize) -> Result<bool, EngineError> {
        if state.known.status[e] != Status::Run || state.running.contains(&e) {
            return Ok(false);
        }
        let twin = |r: &usize| state.known.manifest[*r] == state.known.manifest[e];
        Ok(!state.running.iter().any(twin) && self.inputs_present(state, e)?)
    }

    /// A pass for `e` and as many of those that can share it as the memory allows; none while even `e`
    /// does not fit beside what runs.
    fn pass(&self, state: &mut State, e: usize) -> Result<Option<Next>, EngineError> {
        let (mut jobs, mut total) = (Vec::new(), 0_u64);
        for e in std::iter::once(e).chain(self.together.with(e)) {
            if !self.may_start(state, e)? {
                continue;
            }
            let Some(manifest) = state.known.manifest[e].clone() else { continue };
            let Some(inputs) = state.known.inputs(self.plan, e) else { continue };
            let bindings = Bindings::new(Arc::clone(self.store), inputs);
            let node = &self.graph.nodes[self.plan.executions[e].node];
            let memory = node.node.memory(&bindings.sizes());
            let sum = state.memory.saturating_add(memory);
            if !state.running.is_empty() && sum > self.options.memory {
                continue;
            }
            state.running.insert(e);
            state.memory = sum;
            total = total.saturating_add(memory);
            jobs.push(Job { e, manifest, bindings });
        }
        Ok((!jobs.is_empty()).then_some(Next::Run(jobs, total)))
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

    /// What must stay in the cache while room is made for more, once a tenth of the quota was written:
    /// what is wanted, and all that executions to come will read.
    fn room_is_due(&self, state: &mut State) -> Option<BTreeSet<Digest>> {
        if state.written < self.store.quota() / 10 {
            return None;
        }
        state.written = 0;
        let wanted = self.wanted.iter().flat_map(|&n| state.known.held[n].iter());
        let open = |e: &usize| matches!(state.known.status[*e], Status::Run | Status::Waiting);
        let read = (0..self.plan.executions.len()).filter(open).flat_map(|e| {
            let places = self.plan.executions[e].inputs.iter().flat_map(|(_, places)| places);
            places.map(|&(n, item)| &state.known.held[n][item])
        });
        Some(wanted.chain(read).flatten().map(|held| held.digest).collect())
    }

    fn settle(&self, state: &mut State, e: usize, ended: Result<Ended, EngineError>) {
        let execution = &self.plan.executions[e];
        match ended {
            Ok(Ended { held, seconds, notes, ran }) => {
                state.known.know(self.plan, e, Status::Done, &held);
                let node = &mut state.nodes[execution.node];
                node.ran += usize::from(ran);
                state.written += if ran { held.iter().map(|h| h.bytes).sum() } else { 0 };
                node.seconds += seconds;
                for note in notes {
                    if !node.notes.contains(&note) {
                        node.notes.push(note);
                    }
                }
                self.progress.end(execution.node, execution.run);
            }
            Err(error @ EngineError::Node { .. }) if self.options.keep_going => {
                let problem = error.to_string();
                self.progress.fail(execution.node, execution.run, &problem);
                state.known.fail(e, problem);
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
