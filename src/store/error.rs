//! What can go wrong in the store. Every message names the path and says what to do.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

/// A failure of the cache directory itself. Missing or damaged content is no error: it reads as a miss.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The operating system refused an operation on a file or a directory.
    #[error("cannot {act} {}: {cause}; {}", .path.display(), advice(.cause))]
    Io {
        /// What was tried, as a verb.
        act: &'static str,
        /// The file or directory.
        path: PathBuf,
        /// The answer of the operating system.
        cause: io::Error,
    },
    /// The disk, or the user's share of it, is full.
    #[error(
        "no space left in {}: {needed} bytes are needed; free some space, lower the quota of the cache or choose another cache directory",
        .dir.display()
    )]
    Full {
        /// The directory that was written to.
        dir: PathBuf,
        /// Bytes of the whole file, as far as they were known.
        needed: u64,
    },
    /// The file system keeps no locks.
    #[error(
        "cannot lock {}: {cause}; mount this file system with file locks (flock) or choose a cache directory on another one",
        .path.display()
    )]
    NoLocks {
        /// The lock file.
        path: PathBuf,
        /// The answer of the operating system.
        cause: io::Error,
    },
    /// A blob was finished although one of its writes had failed.
    #[error(
        "an earlier write to {} failed, so the blob is not kept; write it again from its beginning",
        .path.display()
    )]
    Incomplete {
        /// The temporary file of the blob.
        path: PathBuf,
    },
    /// An input file changed each time it was read.
    #[error("{} changes while it is read; run again when its writer is done", .path.display())]
    Changing {
        /// The input file.
        path: PathBuf,
    },
    /// A record cannot be written as text.
    #[error("cannot write the record {} as RON: {cause}; report this with the graph", .path.display())]
    Record {
        /// Where the record was to be.
        path: PathBuf,
        /// The answer of the serialiser.
        cause: ron::Error,
    },
}

impl StoreError {
    /// For `map_err`: the failure of the operation `act` (a verb) on `path`.
    pub(super) fn at(act: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |cause| Self::Io { act, path: path.to_owned(), cause }
    }

    /// For `map_err`: the failure to write the file at `path`, which takes `needed` bytes in all.
    pub(super) fn writing(path: &Path, needed: u64) -> impl FnOnce(io::Error) -> Self {
        move |cause| match cause.kind() {
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
                Self::Full { dir: path.parent().unwrap_or(path).to_owned(), needed }
            }
            _ => Self::Io { act: "write", path: path.to_owned(), cause },
        }
    }
}

impl From<StoreError> for io::Error {
    /// Keeps the kind, so that code which writes through `io::Write` can tell a full disk.
    fn from(error: StoreError) -> Self {
        let kind = match &error {
            StoreError::Io { cause, .. } | StoreError::NoLocks { cause, .. } => cause.kind(),
            StoreError::Full { .. } => ErrorKind::StorageFull,
            _ => ErrorKind::Other,
        };
        Self::new(kind, error)
    }
}

fn advice(cause: &io::Error) -> &'static str {
    match cause.kind() {
        ErrorKind::NotFound => "check the path",
        ErrorKind::PermissionDenied => {
            "check who owns it and its permissions, or choose another cache directory"
        }
        ErrorKind::ReadOnlyFilesystem => "choose a cache directory that can be written to",
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            "free some space or choose another cache directory"
        }
        ErrorKind::NotADirectory | ErrorKind::AlreadyExists => {
            "a file is in the place of a directory: move it away"
        }
        ErrorKind::InvalidInput | ErrorKind::IsADirectory => "name a regular file",
        _ => "check the disk, or choose another cache directory",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_name_the_path_and_the_remedy() {
        let path = Path::new("cache/v1/tmp/7-8-9");
        let full = StoreError::writing(path, 1234)(ErrorKind::StorageFull.into()).to_string();
        assert!(full.contains("cache/v1/tmp:") && full.contains("1234 bytes"), "{full}");
        assert!(full.contains("free some space"), "{full}");
        let denied = StoreError::writing(path, 1)(ErrorKind::PermissionDenied.into()).to_string();
        assert!(denied.contains("7-8-9") && denied.contains("who owns it"), "{denied}");
    }

    #[test]
    fn the_kind_survives_the_way_through_io() {
        let full = StoreError::Full { dir: "d".into(), needed: 1 };
        assert_eq!(io::Error::from(full).kind(), ErrorKind::StorageFull);
    }
}
