//! Running one execution: the lock of its key, the node itself, its blobs and its record.

use super::EngineError;
use super::bindings::{Bindings, Held};
use super::execution::Execution;
use super::manifest::Manifest;
use super::resolve::recorded;
use super::schedule::Shared;
use super::summary::peak_bytes;
use crate::graph::Axis;
use crate::store::Record;
use lightloom_nodes::data::write_arrays;
use lightloom_nodes::node::{Ctx, Error};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

impl Shared<'_> {
    /// Runs one execution, or takes the result another process has made meanwhile.
    pub(super) fn execute(
        &self,
        e: usize,
        manifest: &Manifest,
        bindings: &Bindings,
    ) -> Result<Ended, EngineError> {
        let execution = &self.plan.executions[e];
        let key = manifest.key();
        let cancelled = || self.options.cancelled.load(Ordering::Relaxed);
        let guard = self.store.lock_wait(&key, &cancelled)?.ok_or(EngineError::Cancelled)?;
        if let Some(held) = recorded(manifest, &execution.items, self.store) {
            let mut all = true;
            for h in &held {
                all &= self.store.open_blob(&h.digest, h.bytes)?.is_some();
            }
            if all {
                return Ok(Ended { held, seconds: 0.0, notes: Vec::new(), ran: false });
            }
        }
        let ended = self.compute(execution, manifest, bindings);
        drop(guard);
        ended
    }

    fn compute(
        &self,
        execution: &Execution,
        manifest: &Manifest,
        bindings: &Bindings,
    ) -> Result<Ended, EngineError> {
        let node = &self.graph.nodes[execution.node];
        let failed = |cause: Error| match cause {
            Error::Cancelled => EngineError::Cancelled,
            cause => EngineError::Node {
                name: node.name.clone(),
                kind: node.kind,
                item: told(node.runs, execution.run),
                cause,
            },
        };
        let started = Instant::now();
        let key = manifest.key();
        let (held, notes) = std::thread::scope(|scope| {
            // Progress is handed over by a channel, so that the closure a node holds borrows nothing.
            let (sender, receiver) = std::sync::mpsc::sync_channel::<(u64, u64)>(64);
            let (at, run) = (execution.node, execution.run);
            scope.spawn(move || {
                receiver.iter().for_each(|(done, total)| self.progress.step(at, run, done, total))
            });
            let report = Box::new(move |done, total| {
                // A full channel means that nobody looks so fast: the step is dropped.
                let _ = sender.try_send((done, total));
            });
            let checkpoint = Some(self.store.checkpoint_path(&key));
            let ctx = Ctx::new(
                Arc::clone(&self.options.cancelled),
                Arc::clone(&self.derived),
                report,
                checkpoint,
            );
            let mut held = Vec::new();
            let ran = catch_unwind(AssertUnwindSafe(|| {
                node.node.run(bindings, &ctx, &mut |arrays| {
                    let bytes: usize = arrays.iter().map(|(_, view)| view.bytes.len()).sum();
                    let keep = || -> std::io::Result<_> {
                        let mut writer = self.store.blob_writer(bytes as u64)?;
                        write_arrays(&mut writer, arrays)?;
                        Ok(writer.finish()?)
                    };
                    let (digest, bytes) = keep().map_err(|e| Error::invalid(e.to_string()))?;
                    held.push(Held { digest, bytes });
                    Ok(())
                })
            }));
            match ran {
                Ok(Ok(_)) => Ok((held, ctx.notes())),
                Ok(Err(error)) => Err(failed(error)),
                Err(panic) => Err(failed(Error::invalid(format!(
                    "an error in the node itself: {}",
                    panic_text(&*panic)
                )))),
            }
        })?;
        if held.len() != execution.items.len() {
            let what =
                format!("gave {} items where {} were expected", held.len(), execution.items.len());
            return Err(failed(Error::invalid(what)));
        }
        let seconds = started.elapsed().as_secs_f64();
        for (item, held) in execution.items.clone().zip(&held) {
            self.store.put_record(&Record {
                manifest: manifest.item(item, &execution.items),
                node: node.kind.into(),
                name: node.name.clone(),
                output: held.digest,
                bytes: held.bytes,
                seconds,
                peak_bytes: peak_bytes(),
                made: SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs()),
                version: env!("CARGO_PKG_VERSION").into(),
                notes: notes.clone(),
            })?;
        }
        self.store.drop_checkpoint(&key)?;
        Ok(Ended { held, seconds, notes, ran: true })
    }
}

/// What an execution gave.
pub(super) struct Ended {
    pub(super) held: Vec<Held>,
    pub(super) seconds: f64,
    pub(super) notes: Vec<String>,
    /// False when another process made it.
    pub(super) ran: bool,
}

fn told(runs: Axis, run: usize) -> String {
    match runs {
        Axis::Single => String::new(),
        Axis::Frames => format!(", frame {run}"),
        Axis::Pairs => format!(", pair {run}"),
        Axis::Chunks => format!(", chunk {run}"),
    }
}

fn panic_text(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "no message".into())
}
