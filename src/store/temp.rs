//! Files under construction: written in `tmp`, then renamed to where they belong, so that no reader sees half a file.
//!
//! A temporary file is named `PID-START-N` and locked by its writer. The sweep asks the lock, not the process table: it
//! tells a dead writer from a living one on another host and after process numbers were used again.

use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process;
use std::sync::atomic::Ordering;
use std::time::Duration;

use super::lock::{Take, release, remove_unheld, take};
use super::{Store, StoreError, is_older, with_parent};

const DAY: Duration = Duration::from_secs(24 * 3600);

/// A file that vanishes unless it is kept.
#[derive(Debug)]
pub(super) struct Temp {
    pub(super) file: File,
    pub(super) path: PathBuf,
    kept: bool,
}

impl Temp {
    /// Renames the file to `to`, replacing what is there.
    pub(super) fn keep(mut self, to: &Path) -> Result<(), StoreError> {
        with_parent(to, || fs::rename(&self.path, to)).map_err(StoreError::at("make", to))?;
        self.kept = true;
        Ok(())
    }
}

impl Drop for Temp {
    fn drop(&mut self) {
        if !self.kept {
            // Nothing can be done about a failure here; the next sweep tries again.
            fs::remove_file(&self.path).ok();
        }
        release(&self.file);
    }
}

impl Store {
    /// A new, empty, locked file in `tmp`.
    pub(super) fn temp(&self) -> Result<Temp, StoreError> {
        loop {
            let count = self.next_temp.fetch_add(1, Ordering::Relaxed);
            let name = format!("{}-{}-{count}", process::id(), self.opened);
            let path = self.root.join("tmp").join(name);
            let open = || OpenOptions::new().read(true).write(true).create_new(true).open(&path);
            let file = match with_parent(&path, open) {
                Ok(file) => file,
                Err(cause) if cause.kind() == ErrorKind::AlreadyExists => continue,
                Err(cause) => return Err(StoreError::at("make", &path)(cause)),
            };
            match take(&file, &path) {
                // Without locks the sweep goes by age, so the file is as good as a locked one.
                Ok(Take::Held) | Err(_) => return Ok(Temp { file, path, kept: false }),
                // A sweep came between making and locking the file and removes it.
                Ok(Take::Busy | Take::Stale) => {}
            }
        }
    }

    /// Writes a small text file to `to`, whole or not at all.
    pub(super) fn put_text(&self, to: &Path, text: &str) -> Result<(), StoreError> {
        let mut temp = self.temp()?;
        let failed = |cause| StoreError::writing(to, text.len() as u64)(cause);
        temp.file.write_all(text.as_bytes()).map_err(failed)?;
        temp.keep(to)
    }

    /// Removes the temporary files whose writers are dead. Where locks are not supported: those older than a day.
    /// Names that are not ours stay.
    pub(super) fn sweep_temps(&self) {
        for (name, path) in self.listing("tmp") {
            let numbers = name.split('-').filter(|part| part.parse::<u128>().is_ok()).count();
            if numbers != 3 || name.split('-').count() != 3 {
                continue;
            }
            if remove_unheld(&path).is_err() && is_older(&path, DAY) {
                // A file that cannot be removed harms nobody but the disk; the next sweep tries again.
                fs::remove_file(&path).ok();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{children, open};
    use super::*;
    use std::thread::sleep;

    fn names(store: &Store) -> Vec<String> {
        store.listing("tmp").into_iter().map(|(name, _)| name).collect()
    }

    #[test]
    fn a_dropped_file_leaves_nothing() {
        let (_dir, store) = open();
        drop(store.temp().unwrap());
        assert_eq!(names(&store), [""; 0]);
    }

    #[test]
    fn the_sweep_takes_the_dead_and_leaves_the_living_and_the_foreign() {
        let (dir, store) = open();
        let living = store.temp().unwrap();
        for name in ["1-2-3", "99999999-5-0", "notes.txt", "1-2", "1-2-x"] {
            fs::write(store.root.join("tmp").join(name), "x").unwrap();
        }
        let again = Store::open(dir.path(), None).unwrap();
        let mut left = vec!["1-2".to_owned(), "1-2-x".to_owned(), "notes.txt".to_owned()];
        left.push(living.path.file_name().unwrap().to_str().unwrap().to_owned());
        left.sort();
        assert_eq!(names(&again), left);
    }

    #[test]
    fn killed_writers_leave_a_store_that_works() {
        let (dir, store) = open();
        for round in 0..6 {
            for mut child in children(2, "write", dir.path()) {
                let before = store.records().count();
                for _ in 0..200 {
                    if store.records().count() > before {
                        break;
                    }
                    sleep(Duration::from_millis(2));
                }
                sleep(Duration::from_millis(round));
                child.kill().unwrap();
                child.wait().unwrap();
            }
        }
        let again = Store::open(dir.path(), None).unwrap();
        assert_eq!(names(&again), [""; 0]);
        assert!(again.records().count() > 0);
        for (key, record) in again.records() {
            assert!(again.lock(&key).unwrap().is_some());
            assert!(again.open_blob(&record.output, record.bytes).unwrap().is_some());
        }
        assert_eq!(again.damage(), []);
    }
}
