//! `clean`: what the cache holds, and emptying it.

use super::output::{say, say_json};
use super::session::{Failure, store};
use super::{Common, figures};
use crate::store::{Evicted, Usage};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fmt::Write as _;

#[derive(clap::Args)]
pub struct Clean {
    /// Empties the cache; what is not Lightloom's stays.
    #[arg(long, conflicts_with = "gc")]
    all: bool,
    /// Brings the cache under its quota; what is cheapest to make again goes first.
    #[arg(long)]
    gc: bool,
}

impl Clean {
    pub fn run(&self, common: &Common) -> Result<(), Failure> {
        let store = store(common)?;
        let removed = match (self.all, self.gc) {
            (true, _) => Some(store.clear()?),
            (_, true) => Some(store.evict(&BTreeSet::new())?),
            _ => None,
        };
        // A clear store has no folder any more, and that is what it shall have.
        let usage = if self.all { Usage::default() } else { store.usage()? };
        match (common.json, removed) {
            (true, Some(removed)) => say_json(&removed_json(&removed)),
            (true, None) => say_json(&usage_json(&usage)),
            (false, Some(removed)) => {
                say(removed_text(&removed, self.gc.then_some(usage.quota)) + "\n")
            }
            (false, None) => say(usage_text(&usage, &common.cache.display().to_string())),
        }
    }
}

fn removed_text(removed: &Evicted, quota: Option<u64>) -> String {
    let left = figures::bytes(removed.left);
    match (removed.blobs, quota) {
        (0, Some(quota)) => format!("{left} of {} used: nothing had to go", figures::bytes(quota)),
        (0, None) => "the cache is empty".into(),
        (blobs, _) => {
            format!("{blobs} blobs removed, {}; {left} left", figures::bytes(removed.bytes))
        }
    }
}

fn removed_json(removed: &Evicted) -> Value {
    json!({
        "ok": true, "removed_blobs": removed.blobs, "removed_bytes": removed.bytes, "bytes": removed.left,
    })
}

fn usage_text(usage: &Usage, folder: &str) -> String {
    let (used, quota) = (figures::bytes(usage.bytes), figures::bytes(usage.quota));
    let mut out = format!("{folder}: {used} of {quota} used\n");
    let mut kinds: Vec<_> = usage.kinds.iter().collect();
    kinds.sort_by(|a, b| b.1.bytes.cmp(&a.1.bytes).then(a.0.cmp(b.0)));
    let width = kinds.iter().map(|(kind, _)| kind.len()).max().unwrap_or(0);
    if !kinds.is_empty() {
        let _ = writeln!(
            out,
            "  {:width$}  {:>10}  {:>7}  {:>7}  to make again",
            "", "size", "blobs", "records"
        );
    }
    for (kind, of) in kinds {
        let (size, time) = (figures::bytes(of.bytes), figures::duration(of.seconds));
        let _ = writeln!(
            out,
            "  {kind:width$}  {size:>10}  {:>7}  {:>7}  {time}",
            of.blobs, of.records
        );
    }
    let Usage { blobs, records, evicted, .. } = usage;
    let _ = writeln!(out, "  {blobs} blobs, {records} records, {evicted} of them of evicted blobs");
    let rest = [
        ("blobs without a record", usage.unnamed_bytes),
        ("checkpoints of interrupted runs", usage.checkpoint_bytes),
        ("quarantine of damaged files", usage.quarantine_bytes),
    ];
    for (what, bytes) in rest.iter().filter(|(_, bytes)| *bytes > 0) {
        let _ = writeln!(out, "  {what}: {}", figures::bytes(*bytes));
    }
    out + "`lightloom clean --gc` brings it under the quota, `lightloom clean --all` empties it\n"
}

fn usage_json(usage: &Usage) -> Value {
    let kind = |(kind, of): (&String, &crate::store::KindUsage)| {
        let of = json!({ "records": of.records, "blobs": of.blobs, "bytes": of.bytes, "seconds": of.seconds });
        (kind.clone(), of)
    };
    json!({
        "ok": true, "bytes": usage.bytes, "quota_bytes": usage.quota, "blobs": usage.blobs, "records": usage.records,
        "evicted": usage.evicted, "unnamed": usage.unnamed, "unnamed_bytes": usage.unnamed_bytes,
        "checkpoint_bytes": usage.checkpoint_bytes, "quarantine_bytes": usage.quarantine_bytes,
        "kinds": usage.kinds.iter().map(kind).collect::<serde_json::Map<_, _>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::Bench;
    use super::*;

    #[test]
    fn usage_is_told_by_kind_and_clearing_ends_it() {
        let bench = Bench::new();
        bench.run(&[]);
        let store = &bench.session(&[]).store;
        let usage = store.usage().unwrap();
        let text = usage_text(&usage, "cache");
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[0].starts_with("cache: ") && lines[0].ends_with("of 20.0 GB used"), "{text}");
        assert!(
            lines.iter().any(|l| l.starts_with("  Grey ") && l.contains("        6        6  ")),
            "{text}"
        );
        let json = usage_json(&usage);
        assert_eq!(
            (&json["kinds"]["Grey"]["blobs"], &json["records"]),
            (&json!(6), &json!(usage.records))
        );

        let nothing = store.evict(&BTreeSet::new()).unwrap();
        assert!(
            removed_text(&nothing, Some(usage.quota))
                .ends_with("of 20.0 GB used: nothing had to go")
        );
        let removed = store.clear().unwrap();
        assert_eq!(removed_json(&removed)["removed_blobs"], usage.blobs);
        assert_eq!(store.usage().unwrap().blobs, 0);
        assert_eq!(removed_text(&store.clear().unwrap(), None), "the cache is empty");
    }
}
