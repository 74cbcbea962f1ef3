//! Single flight: one lock file for each action, held by whoever computes it, on this host or another.
//!
//! The lock belongs to the open file, so a killed owner frees it. Lock files are left where they are when released;
//! eviction removes those that nobody holds (see [`remove_unheld`]).

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind};
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::thread::sleep;
use std::time::Duration;

use lightloom_nodes::node::Digest;

use super::{Store, StoreError, with_parent};

/// The right to compute one action, until it is dropped or the process ends.
#[derive(Debug)]
#[must_use = "the lock is released as soon as the guard is dropped"]
pub struct Guard {
    held: File,
}

impl Drop for Guard {
    fn drop(&mut self) {
        release(&self.held);
    }
}

impl Store {
    /// Takes the lock of the action `key`; None while another thread or process has it. Whoever gets it must ask for
    /// the record again: the last owner may just have written it.
    pub fn lock(&self, key: &Digest) -> Result<Option<Guard>, StoreError> {
        lock_at(&self.shelf("lock", key))
    }

    /// Waits for the lock of the action `key`; None when `cancelled` (asked at least every 50 ms) says so first.
    pub fn lock_wait(
        &self,
        key: &Digest,
        cancelled: &dyn Fn() -> bool,
    ) -> Result<Option<Guard>, StoreError> {
        let mut pause = Duration::from_millis(1);
        while !cancelled() {
            if let Some(guard) = self.lock(key)? {
                return Ok(Some(guard));
            }
            sleep(pause);
            pause = (pause * 2).min(Duration::from_millis(50));
        }
        Ok(None)
    }
}

/// Takes the lock at `path`, whose file is made when missing; None while it is held.
pub(super) fn lock_at(path: &Path) -> Result<Option<Guard>, StoreError> {
    loop {
        let open =
            || OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path);
        let file = with_parent(path, open).map_err(StoreError::at("open", path))?;
        match take(&file, path) {
            Ok(Take::Held) => return Ok(Some(Guard { held: file })),
            Ok(Take::Busy) => return Ok(None),
            Ok(Take::Stale) => {}
            Err(cause) => return Err(StoreError::NoLocks { path: path.to_owned(), cause }),
        }
    }
}

/// The outcome of trying to lock an open file.
pub(super) enum Take {
    /// This open file has the lock, and the path leads to it.
    Held,
    /// Another open file has the lock.
    Busy,
    /// The path was removed or leads to another file by now: this lock keeps nobody out.
    Stale,
}

/// Locks `file`, opened from `path`. The look at the path after locking closes the race between opening and unlinking:
/// a file is only unlinked by somebody who holds its lock, so a held file that its path still names stays there.
pub(super) fn take(file: &File, path: &Path) -> io::Result<Take> {
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => return Ok(Take::Busy),
        Err(TryLockError::Error(cause)) => return Err(cause),
    }
    let held = file.metadata()?;
    let taken = match fs::metadata(path) {
        Ok(named) if (named.dev(), named.ino()) == (held.dev(), held.ino()) => {
            return Ok(Take::Held);
        }
        Ok(_) => Ok(Take::Stale),
        Err(cause) if cause.kind() == ErrorKind::NotFound => Ok(Take::Stale),
        Err(cause) => Err(cause),
    };
    release(file);
    taken
}

/// Frees the lock of `file` at once. Closing alone does not: a process that is just being started by another thread
/// holds a copy of every open file until its program is loaded, and with it the lock.
pub(super) fn release(file: &File) {
    // Should it fail, the lock ends with the last copy of the file.
    file.unlock().ok();
}

/// Removes the file at `path` unless somebody holds its lock. True when it is gone; an error when the lock cannot be
/// tried at all.
pub(super) fn remove_unheld(path: &Path) -> io::Result<bool> {
    // Network file systems lock only what is open for writing; a finished blob can be opened for reading only.
    let file =
        OpenOptions::new().read(true).write(true).open(path).or_else(|_| File::open(path))?;
    match take(&file, path)? {
        Take::Held => {
            let _guard = Guard { held: file };
            fs::remove_file(path).map(|()| true)
        }
        Take::Busy | Take::Stale => Ok(false),
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{children, demand, keys, open};
    use super::*;
    use std::collections::BTreeSet;
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::thread::scope;

    #[test]
    fn a_lock_is_held_once_and_freed_by_dropping_it() {
        let (dir, store) = open();
        let key = Digest::of(b"key");
        let guard = store.lock(&key).unwrap().unwrap();
        assert!(store.lock(&key).unwrap().is_none());
        assert!(Store::open(dir.path(), None).unwrap().lock(&key).unwrap().is_none());
        assert!(store.lock(&Digest::of(b"other")).unwrap().is_some());
        drop(guard);
        assert!(store.lock(&key).unwrap().is_some());
    }

    #[test]
    fn a_copy_of_the_open_file_does_not_keep_the_lock() {
        let (_dir, store) = open();
        let key = Digest::of(b"key");
        let guard = store.lock(&key).unwrap().unwrap();
        let _copy = guard.held.try_clone().unwrap();
        drop(guard);
        assert!(store.lock(&key).unwrap().is_some());
        let temp = store.temp().unwrap();
        let (_copy, to) = (temp.file.try_clone().unwrap(), store.root.join("kept"));
        temp.keep(&to).unwrap();
        assert!(remove_unheld(&to).unwrap());
    }

    #[test]
    fn waiting_ends_when_cancelled() {
        let (_dir, store) = open();
        let key = Digest::of(b"key");
        let _guard = store.lock(&key).unwrap().unwrap();
        let asked = AtomicU32::new(0);
        let cancelled = || asked.fetch_add(1, Ordering::Relaxed) == 3;
        assert!(store.lock_wait(&key, &cancelled).unwrap().is_none());
        assert_eq!(asked.into_inner(), 4);
    }

    #[test]
    fn the_lock_of_a_removed_or_replaced_file_is_worth_nothing() {
        let (dir, _store) = open();
        let path = dir.path().join("lock");
        let opened = File::create(&path).unwrap();
        assert!(remove_unheld(&path).unwrap());
        assert!(matches!(take(&opened, &path), Ok(Take::Stale)));
        let guard = lock_at(&path).unwrap().unwrap();
        assert!(matches!(take(&opened, &path), Ok(Take::Stale)));
        assert!(!remove_unheld(&path).unwrap() && path.exists());
        drop(guard);
        assert!(remove_unheld(&path).unwrap() && !path.exists());
    }

    #[test]
    fn threads_compute_each_key_once() {
        let (dir, store) = open();
        let log = dir.path().join("log");
        scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| demand(&store, &keys(20), &log));
            }
        });
        let computed = fs::read_to_string(&log).unwrap();
        assert_eq!(computed.lines().count(), 20);
        assert_eq!(computed.lines().collect::<BTreeSet<_>>().len(), 20);
    }

    #[test]
    fn processes_compute_each_key_once() {
        let (dir, _store) = open();
        let log = dir.path().join("log");
        for mut child in children(3, "demand", dir.path()) {
            assert!(child.wait().unwrap().success());
        }
        let computed = fs::read_to_string(&log).unwrap();
        assert_eq!(computed.lines().count(), 20);
        assert_eq!(computed.lines().collect::<BTreeSet<_>>().len(), 20);
    }
}
