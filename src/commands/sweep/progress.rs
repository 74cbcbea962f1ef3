//! Progress of a sweep: node runs, finished points, and failures as they happen.

use crate::engine::Progress;
use crate::sweep::{Group, Outline};
use indicatif::{ProgressBar, ProgressStyle};
use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// Time between two lines where there is no terminal.
const PAUSE: Duration = Duration::from_secs(5);

/// Follows one group of points.
pub struct Points<'a> {
    outline: &'a Outline,
    /// The execution that is a given run of a node.
    execution: BTreeMap<(usize, usize), usize>,
    /// The points that need each execution.
    needed_by: Vec<Vec<usize>>,
    /// A bar on a terminal; none for machines.
    bar: Option<ProgressBar>,
    started: Instant,
    state: Mutex<State>,
}

struct State {
    /// Executions that each point still waits for.
    open: BTreeMap<usize, usize>,
    /// Executions that need not run, that ended, and all.
    hits: usize,
    ended: usize,
    all: usize,
    /// How far those under way are.
    under_way: BTreeMap<usize, f64>,
    told: Instant,
}

impl<'a> Points<'a> {
    /// Nothing has run yet; `silent` for machines.
    pub fn new(group: &Group, outline: &'a Outline, silent: bool) -> Self {
        let executions = &group.plan.executions;
        let runs = executions.iter().enumerate().map(|(e, x)| ((x.node, x.run), e));
        let mut needed_by = vec![Vec::new(); executions.len()];
        let mut open = BTreeMap::new();
        for member in &group.members {
            let needed = group.executions(member);
            needed.iter().for_each(|&e| needed_by[e].push(member.point));
            open.insert(member.point, needed.len());
        }
        let style = ProgressStyle::with_template("  [{bar:40}] {percent:>3} %  {msg}  {eta} left");
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        let hidden = silent || !std::io::stderr().is_terminal();
        let now = Instant::now();
        Points {
            outline,
            execution: runs.collect(),
            needed_by,
            bar: (!hidden).then(|| ProgressBar::new(1000).with_style(style)),
            started: now,
            state: Mutex::new(State {
                open,
                hits: 0,
                ended: 0,
                all: executions.len(),
                under_way: BTreeMap::new(),
                // In the past for machines, whose lines never come.
                told: if silent { now + Duration::from_secs(u32::MAX.into()) } else { now },
            }),
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    fn show(&self, state: &mut State) {
        let points = state.open.len();
        let finished = state.open.values().filter(|left| **left == 0).count();
        let message = format!(
            "{}/{} node runs, {finished}/{points} points",
            state.hits + state.ended,
            state.all
        );
        match &self.bar {
            Some(bar) => {
                let far = state.ended as f64 + state.under_way.values().sum::<f64>();
                let to_run = state.all.saturating_sub(state.hits).max(1);
                bar.set_position((1000.0 * far / to_run as f64).min(1000.0) as u64);
                bar.set_message(message);
            }
            None if state.told.elapsed() >= PAUSE => {
                state.told = Instant::now();
                eprintln!("[{:6.1} s] {message}", self.started.elapsed().as_secs_f64());
            }
            None => {}
        }
    }
}

impl Progress for Points<'_> {
    fn start(&self, _: usize, _: &str, _: usize, hits: usize) {
        self.lock().hits += hits;
    }

    fn step(&self, node: usize, run: usize, done: u64, total: u64) {
        let Some(&e) = self.execution.get(&(node, run)) else { return };
        let mut state = self.lock();
        state.under_way.insert(e, (done as f64 / total.max(1) as f64).min(1.0));
        self.show(&mut state);
    }

    fn end(&self, node: usize, run: usize) {
        let Some(&e) = self.execution.get(&(node, run)) else { return };
        let mut state = self.lock();
        state.under_way.remove(&e);
        state.ended += 1;
        for point in &self.needed_by[e] {
            if let Some(left) = state.open.get_mut(point) {
                *left = left.saturating_sub(1);
            }
        }
        self.show(&mut state);
    }

    fn fail(&self, node: usize, run: usize, problem: &str) {
        let e = self.execution.get(&(node, run));
        let points = e.map_or(&[][..], |&e| &self.needed_by[e]);
        let tell = || {
            eprintln!("failed: {problem}");
            points.iter().for_each(|&p| eprintln!("        so does {}", self.outline.label(p)));
        };
        match &self.bar {
            Some(bar) => bar.suspend(tell),
            None => tell(),
        }
    }
}

impl Drop for Points<'_> {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
