//! Progress for people: bars with the time left on a terminal, plain lines elsewhere.

use crate::engine::Progress;
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// Says nothing.
pub struct Silent;

impl Progress for Silent {
    fn start(&self, _: usize, _: &str, _: usize, _: usize) {}
    fn step(&self, _: usize, _: usize, _: u64, _: u64) {}
    fn end(&self, _: usize, _: usize) {}
}

/// How far one node is, in executions; those under way count by their share.
struct Far {
    name: String,
    total: usize,
    done: usize,
    under_way: BTreeMap<usize, f64>,
}

impl Far {
    fn fraction(&self) -> f64 {
        (self.done as f64 + self.under_way.values().sum::<f64>()) / self.total.max(1) as f64
    }

    fn step(&mut self, run: usize, done: u64, total: u64) {
        let at = self.under_way.entry(run).or_default();
        *at = at.max(done as f64 / total.max(1) as f64).min(1.0);
    }

    fn end(&mut self, run: usize) {
        self.under_way.remove(&run);
        self.done = (self.done + 1).min(self.total);
    }
}

fn hold<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// Steps of a bar: executions are too coarse for nodes that run once.
const STEPS: f64 = 1000.0;

/// One bar for each node that has something to run.
pub struct Bars {
    all: MultiProgress,
    nodes: Mutex<BTreeMap<usize, (Far, ProgressBar)>>,
}

impl Bars {
    /// No bars yet.
    pub fn new() -> Self {
        Bars { all: MultiProgress::new(), nodes: Mutex::default() }
    }

    fn update(&self, node: usize, change: impl FnOnce(&mut Far)) {
        if let Some((far, bar)) = hold(&self.nodes).get_mut(&node) {
            change(far);
            bar.set_position((far.fraction() * STEPS) as u64);
            bar.set_message(format!("{}/{}", far.done, far.total));
            if far.done == far.total {
                bar.finish();
            }
        }
    }
}

impl Progress for Bars {
    fn start(&self, node: usize, name: &str, total: usize, hits: usize) {
        if hits == total {
            return;
        }
        let style = ProgressStyle::with_template(
            "  {prefix:16} [{bar:30}] {percent:>3} %  {msg:9} {eta:>5} left",
        );
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        let bar = self.all.add(ProgressBar::new(STEPS as u64)).with_style(style);
        bar.set_prefix(name.to_owned());
        let far = Far { name: name.into(), total, done: hits, under_way: BTreeMap::new() };
        bar.set_position((far.fraction() * STEPS) as u64);
        bar.reset_eta();
        hold(&self.nodes).insert(node, (far, bar));
    }
    fn step(&self, node: usize, run: usize, done: u64, total: u64) {
        self.update(node, |far| far.step(run, done, total));
    }
    fn end(&self, node: usize, run: usize) {
        self.update(node, |far| far.end(run));
    }
}

impl Drop for Bars {
    fn drop(&mut self) {
        let _ = self.all.clear();
    }
}

/// A line now and then, for logs.
pub struct Lines {
    started: Instant,
    state: Mutex<(BTreeMap<usize, Far>, Instant)>,
}

/// Time between two lines.
const PAUSE: Duration = Duration::from_secs(5);

impl Lines {
    /// No line yet.
    pub fn new() -> Self {
        Lines { started: Instant::now(), state: Mutex::new((BTreeMap::new(), Instant::now())) }
    }

    fn update(&self, node: usize, change: impl FnOnce(&mut Far)) {
        let mut state = hold(&self.state);
        let (nodes, last) = &mut *state;
        let Some(far) = nodes.get_mut(&node) else { return };
        change(far);
        let line =
            format!("{} {:.0} % ({}/{})", far.name, 100.0 * far.fraction(), far.done, far.total);
        if last.elapsed() >= PAUSE {
            *last = Instant::now();
            eprintln!("[{:6.1} s] {line}", self.started.elapsed().as_secs_f64());
        }
    }
}

impl Progress for Lines {
    fn start(&self, node: usize, name: &str, total: usize, hits: usize) {
        let far = Far { name: name.into(), total, done: hits, under_way: BTreeMap::new() };
        hold(&self.state).0.insert(node, far);
    }
    fn step(&self, node: usize, run: usize, done: u64, total: u64) {
        self.update(node, |far| far.step(run, done, total));
    }
    fn end(&self, node: usize, run: usize) {
        self.update(node, |far| far.end(run));
    }
}
