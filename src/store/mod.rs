//! The cache: what was computed, under the digest of what made it, in plain files.
//!
//! ```text
//! DIR/v1/ac/ab/abcd..     one record for each action, RON text
//!        cas/ef/ef01..    results (blobs), named by the digest of their bytes, read-only
//!        lock/ab/abcd..   locked by whoever computes the action
//!        part/abcd..      checkpoints of interrupted actions
//!        stat/12/1234..   remembered digests of input files
//!        tmp/PID-START-N  files under construction
//!        quarantine/      records and blobs that were found damaged
//! ```
//! Any number of processes on any number of hosts may use one directory. There is no index and no database: a record
//! without its blob is a miss, and so is anything torn, altered or cut short, which is moved to the quarantine and
//! reported by [`Store::damage`]. Nothing is synced to the disk: what a power loss takes is found damaged and made again.

mod blob;
mod clear;
mod contents;
mod digest;
mod error;
mod evict;
mod files;
mod lock;
mod record;
mod temp;

use std::collections::BTreeMap;
use std::fmt::{self, Display};
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicU64;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use lightloom_nodes::node::Digest;

pub use blob::BlobWriter;
pub use contents::{KindUsage, Usage};
pub use digest::key_of;
pub use error::StoreError;
pub use evict::Evicted;
pub use lock::Guard;
pub use record::Record;

use files::Stamp;

/// The quota of a store that was opened without one: 20 GB of blobs.
pub const DEFAULT_QUOTA: u64 = 20_000_000_000;

const WEEK: Duration = Duration::from_secs(7 * 24 * 3600);

/// A cache directory. All methods take `&self` and may be called from any thread.
#[derive(Debug)]
pub struct Store {
    root: PathBuf,
    quota: u64,
    /// Nanoseconds since 1970 when the store was opened: keeps temporary names apart when process numbers come again.
    opened: u128,
    next_temp: AtomicU64,
    /// Blobs this process wrote or verified, as they were then.
    trusted: Mutex<BTreeMap<Digest, Stamp>>,
    damage: Mutex<Vec<Damage>>,
}

/// Something in the cache that was not as it was written. It read as a miss.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// The record or blob, where it was.
    pub path: PathBuf,
    /// Where it is kept for inspection, for seven days; None when it could not be moved.
    pub moved: Option<PathBuf>,
    /// What is wrong with it.
    pub problem: String,
}

impl Display for Damage {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}: {}", self.path.display(), self.problem)?;
        match &self.moved {
            Some(moved) => write!(out, "; moved to {}, it will be made again", moved.display()),
            None => write!(out, "; it stays there and will be made again"),
        }
    }
}

impl Store {
    /// Opens the cache in `dir`, which is made when missing, with a quota for the blobs in bytes (None:
    /// [`DEFAULT_QUOTA`]; `u64::MAX` for no limit). Removes what dead writers left in `tmp`, and checkpoints and
    /// quarantined files of more than seven days. Fails when the directory can be neither found nor made.
    pub fn open(dir: &Path, quota_bytes: Option<u64>) -> Result<Self, StoreError> {
        let root = dir.join("v1");
        let temps = root.join("tmp");
        fs::create_dir_all(&temps).map_err(StoreError::at("make", &temps))?;
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let store = Self {
            root,
            quota: quota_bytes.unwrap_or(DEFAULT_QUOTA),
            opened: now.as_nanos(),
            next_temp: AtomicU64::new(0),
            trusted: Mutex::default(),
            damage: Mutex::default(),
        };
        store.sweep_temps();
        let parts = store.listing("part").into_iter().filter(|(name, _)| is_checkpoint(name));
        let damaged = store.listing("quarantine").into_iter().filter(|(name, _)| is_damaged(name));
        for (_, path) in parts.chain(damaged) {
            if is_older(&path, WEEK) {
                // What cannot be removed costs only room; the next opening tries again.
                fs::remove_file(path).ok();
            }
        }
        Ok(store)
    }

    /// Most bytes of blobs that it shall hold.
    pub fn quota(&self) -> u64 {
        self.quota
    }

    /// What was found damaged since this store was opened, in the order of finding.
    pub fn damage(&self) -> Vec<Damage> {
        locked(&self.damage).clone()
    }

    /// Where the interrupted action `key` keeps what it has so far. Its directory is made. Write beside it, under its
    /// name and an ending, and rename, so that a kill leaves the last whole checkpoint. Removed after seven days.
    pub fn checkpoint_path(&self, key: &Digest) -> PathBuf {
        let parts = self.root.join("part");
        // Without its directory the caller cannot write the checkpoint, and reports that with the path.
        fs::create_dir_all(&parts).ok();
        parts.join(key.to_string())
    }

    /// Removes the checkpoint of `key`, if there is one: its action is done.
    pub fn drop_checkpoint(&self, key: &Digest) -> Result<(), StoreError> {
        let path = self.root.join("part").join(key.to_string());
        match fs::remove_file(&path) {
            Err(cause) if cause.kind() != ErrorKind::NotFound => {
                Err(StoreError::at("remove", &path)(cause))
            }
            _ => Ok(()),
        }
    }

    /// The file of `digest` in one of the directories with two hexadecimal digits of fan-out.
    fn shelf(&self, shelf: &str, digest: &Digest) -> PathBuf {
        self.root.join(shelf).join(format!("{:02x}", digest.0[0])).join(digest.to_string())
    }

    /// The files on `shelf` whose digests begin with `byte`, by digest. Foreign files are not listed.
    fn shelved(&self, shelf: &str, byte: u8) -> Result<Vec<(Digest, PathBuf)>, StoreError> {
        let dir = self.root.join(shelf).join(format!("{byte:02x}"));
        let entries = match fs::read_dir(&dir) {
            Ok(entries) => entries,
            Err(cause) if cause.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            Err(cause) => return Err(StoreError::at("list", &dir)(cause)),
        };
        let mut found = Vec::new();
        for entry in entries {
            let entry = entry.map_err(StoreError::at("list", &dir))?;
            let digest = entry.file_name().to_str().and_then(|name| name.parse::<Digest>().ok());
            if let Some(digest) = digest.filter(|digest| digest.0[0] == byte) {
                found.push((digest, entry.path()));
            }
        }
        found.sort();
        Ok(found)
    }

    /// The names and paths in a directory without fan-out, by name; nothing when it cannot be listed.
    fn listing(&self, shelf: &str) -> Vec<(String, PathBuf)> {
        let entries = fs::read_dir(self.root.join(shelf)).into_iter().flatten().flatten();
        let mut found: Vec<_> = entries
            .filter_map(|entry| Some((entry.file_name().into_string().ok()?, entry.path())))
            .collect();
        found.sort();
        found
    }

    /// Moves the damaged file of `digest` out of the way, and notes it.
    fn quarantine(&self, shelf: &str, digest: &Digest, problem: String) {
        let path = self.shelf(shelf, digest);
        let moved = self.root.join("quarantine").join(format!("{shelf}-{digest}"));
        let moved = match with_parent(&moved, || fs::rename(&path, &moved)) {
            Ok(()) => {
                // The week in quarantine begins now; without the new time it is shorter.
                let file = fs::File::open(&moved);
                file.and_then(|file| file.set_modified(SystemTime::now())).ok();
                Some(moved)
            }
            // Somebody else found it as well, moved it and reports it.
            Err(cause) if cause.kind() == ErrorKind::NotFound => return,
            Err(_) => None,
        };
        self.note(Damage { path, moved, problem });
    }

    fn note(&self, damage: Damage) {
        locked(&self.damage).push(damage);
    }
}

/// What is behind `mutex`. A panic elsewhere cannot leave these lists half changed.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs `make`, which makes a file at `path`; once more with the directory made when that is missing, since clearing
/// the cache may remove a directory at any time.
fn with_parent<T>(path: &Path, make: impl Fn() -> io::Result<T>) -> io::Result<T> {
    match (make(), path.parent()) {
        (Err(cause), Some(dir)) if cause.kind() == ErrorKind::NotFound => {
            fs::create_dir_all(dir)?;
            make()
        }
        (made, _) => made,
    }
}

/// True when the file was last modified more than `age` ago; false when that is unknown.
fn is_older(path: &Path, age: Duration) -> bool {
    let time = fs::metadata(path).and_then(|meta| meta.modified());
    time.is_ok_and(|time| SystemTime::now().duration_since(time).is_ok_and(|since| since > age))
}

/// True for the names of checkpoints and of what is written beside them.
fn is_checkpoint(name: &str) -> bool {
    name.get(..64).is_some_and(|key| key.parse::<Digest>().is_ok())
}

/// True for the names that the quarantine gives.
fn is_damaged(name: &str) -> bool {
    let digest = name.strip_prefix("ac-").or_else(|| name.strip_prefix("cas-"));
    digest.is_some_and(|digest| digest.parse::<Digest>().is_ok())
}

#[cfg(test)]
mod tests;
