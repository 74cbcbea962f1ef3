//! What a running node may use that cannot change its output: progress, cancellation, shared
//! intermediate results, notes for the record, and a place for a checkpoint.

use super::{Digest, Error};
use std::any::{Any, TypeId};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock};

type Progress = Box<dyn Fn(u64, u64) + Send + Sync>;

/// The surroundings of one run of one node.
pub struct Ctx {
    cancelled: Arc<AtomicBool>,
    progress: Progress,
    derived: Arc<Derived>,
    checkpoint: Option<PathBuf>,
    notes: Mutex<Vec<String>>,
    evaluations: AtomicU64,
    pass_evaluations: AtomicU64,
}

impl Default for Ctx {
    /// A context for using nodes as a plain library: silent, never cancelled, one gigabyte of
    /// derived results.
    fn default() -> Self {
        Ctx::new(Arc::default(), Arc::new(Derived::new(1 << 30)), Box::new(|_, _| {}), None)
    }
}

impl Ctx {
    /// A context that stops when `cancelled` becomes true and reports `(done, total)` to `progress`.
    /// `checkpoint` is a file that outlives an interrupted run of the same action.
    pub fn new(
        cancelled: Arc<AtomicBool>,
        derived: Arc<Derived>,
        progress: Progress,
        checkpoint: Option<PathBuf>,
    ) -> Self {
        Ctx {
            cancelled,
            progress,
            derived,
            checkpoint,
            notes: Mutex::default(),
            evaluations: AtomicU64::new(0),
            pass_evaluations: AtomicU64::new(0),
        }
    }

    /// Progress and cancellation in one call: `done` of `total` steps of any size.
    ///
    /// # Errors
    /// [`Error::Cancelled`] once the run was asked to stop.
    pub fn tick(&self, done: u64, total: u64) -> Result<(), Error> {
        if self.cancelled.load(Ordering::Relaxed) {
            return Err(Error::Cancelled);
        }
        (self.progress)(done, total);
        Ok(())
    }

    /// Tells the record of this run what was repaired or left out, with its count.
    pub fn note(&self, text: impl Into<String>) {
        let mut notes = self.notes.lock().expect("no holder of this lock panics");
        let text = text.into();
        if !notes.contains(&text) {
            notes.push(text);
        }
    }

    /// The notes so far.
    pub fn notes(&self) -> Vec<String> {
        self.notes.lock().expect("no holder of this lock panics").clone()
    }

    /// Adds to the number of matrix elements that this run stands for: its cost on any machine. An
    /// element counts whether or not it needed a ray, and after a checkpoint as if there were none.
    pub fn evaluated(&self, elements: u64) {
        self.evaluations.fetch_add(elements, Ordering::Relaxed);
    }

    /// The number so far.
    pub fn evaluations(&self) -> u64 {
        self.evaluations.load(Ordering::Relaxed)
    }

    /// Adds to the number of matrix elements that the pass evaluated in which this run was one of
    /// several: what they share counts once, so that its own part of the time can be told.
    pub fn pass_evaluated(&self, elements: u64) {
        self.pass_evaluations.fetch_add(elements, Ordering::Relaxed);
    }

    /// That number so far; at least the run's own.
    pub fn pass_evaluations(&self) -> u64 {
        self.pass_evaluations.load(Ordering::Relaxed).max(self.evaluations())
    }

    /// The file in which an interrupted run left its state and may leave it again.
    pub fn checkpoint(&self) -> Option<&Path> {
        self.checkpoint.as_deref()
    }

    /// An intermediate result that is a function of the contents named by `of` and is too large to
    /// be an artifact (a posed hierarchy, say): built once, shared by whoever asks for the same.
    ///
    /// # Errors
    /// What `build` returns; a failed build is not kept.
    pub fn derive<T: Any + Send + Sync>(
        &self,
        of: &[Digest],
        build: impl FnOnce() -> Result<(T, usize), Error>,
    ) -> Result<Arc<T>, Error> {
        self.derived.get(of, build)
    }
}

struct Entry {
    key: (TypeId, Vec<Digest>),
    slot: Arc<Slot>,
}

#[derive(Default)]
struct Slot {
    building: Mutex<()>,
    value: OnceLock<(Arc<dyn Any + Send + Sync>, usize)>,
}

/// A bounded, least-recently-used store of derived results, shared by all nodes of a run.
pub struct Derived {
    limit: usize,
    /// Most recently used last.
    entries: Mutex<Vec<Entry>>,
}

impl Derived {
    /// Keeps at most about `limit` bytes; the newest result is kept whatever its size.
    pub fn new(limit: usize) -> Self {
        Derived { limit, entries: Mutex::default() }
    }

    fn get<T: Any + Send + Sync>(
        &self,
        of: &[Digest],
        build: impl FnOnce() -> Result<(T, usize), Error>,
    ) -> Result<Arc<T>, Error> {
        let key = (TypeId::of::<T>(), of.to_vec());
        let slot = self.slot(key);
        // One builder per slot: a second asker waits for the first one's result instead of
        // building the same hierarchy beside it.
        let building = slot.building.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if slot.value.get().is_none() {
            let (value, bytes) = build()?;
            let _ = slot.value.set((Arc::new(value), bytes));
            self.evict();
        }
        drop(building);
        let (value, _) = slot.value.get().expect("set above");
        Ok(Arc::clone(value).downcast().expect("the key holds the type"))
    }

    fn slot(&self, key: (TypeId, Vec<Digest>)) -> Arc<Slot> {
        let mut entries = self.entries.lock().expect("no holder of this lock panics");
        let entry = match entries.iter().position(|e| e.key == key) {
            Some(at) => entries.remove(at),
            None => Entry { key, slot: Arc::default() },
        };
        let slot = Arc::clone(&entry.slot);
        entries.push(entry);
        slot
    }

    fn evict(&self) {
        let mut entries = self.entries.lock().expect("no holder of this lock panics");
        let size = |e: &Entry| e.slot.value.get().map_or(0, |(_, bytes)| *bytes);
        let mut total: usize = entries.iter().map(size).sum();
        while total > self.limit && entries.len() > 1 {
            total -= size(&entries.remove(0));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicUsize;

    #[test]
    fn derives_once_and_evicts_the_oldest() {
        let builds = AtomicUsize::new(0);
        let derived = Derived::new(100);
        let get = |name: &[u8]| {
            let value = derived.get::<usize>(&[Digest::of(name)], || {
                builds.fetch_add(1, Ordering::Relaxed);
                Ok((name.len(), 60))
            });
            *value.unwrap()
        };
        assert_eq!((get(b"a"), get(b"a"), builds.load(Ordering::Relaxed)), (1, 1, 1));
        assert_eq!((get(b"bb"), get(b"a"), builds.load(Ordering::Relaxed)), (2, 1, 3));
    }

    #[test]
    fn a_failed_build_is_not_kept() {
        let derived = Derived::new(100);
        let key = [Digest::of(b"x")];
        assert!(derived.get::<u32>(&key, || Err(Error::invalid("no"))).is_err());
        assert_eq!(*derived.get::<u32>(&key, || Ok((7, 4))).unwrap(), 7);
    }

    #[test]
    fn a_cancelled_context_says_so() {
        let stop = Arc::new(AtomicBool::new(false));
        let ctx = Ctx::new(Arc::clone(&stop), Arc::new(Derived::new(1)), Box::new(|_, _| {}), None);
        assert!(ctx.tick(1, 2).is_ok());
        stop.store(true, Ordering::Relaxed);
        assert!(matches!(ctx.tick(1, 2), Err(Error::Cancelled)));
    }
}
