//! Clearing the cache: what is ours goes, what is foreign stays.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use super::lock::remove_unheld;
use super::{Evicted, Store, StoreError, is_checkpoint, is_damaged, locked};

impl Store {
    /// Removes everything that a store puts into its directory, but for the locks and unfinished files of whoever is
    /// at work; foreign files stay, with their directories. The store can be used on.
    pub fn clear(&self) -> Result<Evicted, StoreError> {
        let mut done = Evicted::default();
        for (_, blob) in self.blobs()? {
            remove(&blob.path)?;
            done.blobs += 1;
            done.bytes += blob.bytes;
        }
        locked(&self.trusted).clear();
        for (_, path) in self.all("ac")?.into_iter().chain(self.all("stat")?) {
            remove(&path)?;
        }
        let locks = self.all("lock")?.into_iter().map(|(_, path)| path);
        for path in locks.chain([self.root.join("lock").join("evict")]) {
            // A lock in use stays, and one that is gone is what was wanted.
            remove_unheld(&path).ok();
        }
        self.sweep_temps();
        for (shelf, is_ours) in
            [("part", is_checkpoint as fn(&str) -> bool), ("quarantine", is_damaged)]
        {
            for (name, path) in self.listing(shelf) {
                if is_ours(&name) {
                    remove(&path)?;
                }
            }
        }
        self.remove_empty_directories();
        Ok(done)
    }

    fn remove_empty_directories(&self) {
        // Only empty directories can be removed this way: a failure means that something foreign or in use is there.
        for shelf in ["ac", "cas", "lock", "part", "stat", "tmp", "quarantine"] {
            let dir = self.root.join(shelf);
            for byte in 0..=u8::MAX {
                fs::remove_dir(dir.join(format!("{byte:02x}"))).ok();
            }
            fs::remove_dir(dir).ok();
        }
        fs::remove_dir(&self.root).ok();
    }
}

/// Removes a file; one that is gone already is no failure.
pub(super) fn remove(path: &Path) -> Result<(), StoreError> {
    match fs::remove_file(path) {
        Err(cause) if cause.kind() != ErrorKind::NotFound => {
            Err(StoreError::at("remove", path)(cause))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::key_of;
    use super::super::tests::{files, open, put};
    use super::*;

    #[test]
    fn clearing_removes_ours_and_leaves_the_rest() {
        let (dir, store) = open();
        let digest = put(&store, 1, 0, Some(1.0));
        let damaged = put(&store, 2, 0, None);
        store.quarantine("cas", &damaged, "looked at".to_owned());
        fs::write(store.checkpoint_path(&key_of("part")), "half").unwrap();
        drop(store.lock(&key_of("lock")).unwrap());
        let foreign =
            ["notes.txt", "v1/notes.txt", "v1/cas/notes.txt", "v1/part/notes.txt", "v2/x"];
        fs::create_dir(dir.path().join("v2")).unwrap();
        for name in foreign {
            fs::write(dir.path().join(name), "mine").unwrap();
        }
        let done = store.clear().unwrap();
        assert_eq!((done.blobs, done.bytes), (1, 1000));
        assert_eq!(files(dir.path()), foreign.len());
        assert!(foreign.iter().all(|name| dir.path().join(name).exists()));
        assert!(!store.root.join("ac").exists());

        assert!(store.open_blob(&digest, 1000).unwrap().is_none());
        put(&store, 1, 0, Some(1.0));
        assert!(store.open_blob(&digest, 1000).unwrap().is_some());
        fs::remove_file(store.root.join("notes.txt")).unwrap();
        for name in ["v1/cas/notes.txt", "v1/part/notes.txt"] {
            fs::remove_file(dir.path().join(name)).unwrap();
        }
        store.clear().unwrap();
        assert!(!store.root.exists());
    }
}
