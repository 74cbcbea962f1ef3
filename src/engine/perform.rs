//! Running executions, those that share a pass at once: the locks of their keys, the node itself, its
//! blobs and its records.

use super::EngineError;
use super::bindings::{Bindings, Held};
use super::manifest::Manifest;
use super::resolve::recorded;
use super::schedule::Shared;
use super::summary::peak_bytes;
use crate::graph::Axis;
use crate::store::{Guard, Record};
use lightloom_nodes::data::write_arrays;
use lightloom_nodes::node::{Ctx, Digest, Error};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// One execution that is about to run.
pub(super) struct Job {
    pub(super) e: usize,
    pub(super) manifest: Manifest,
    pub(super) bindings: Bindings,
}

/// What a node gave for one execution, before it is recorded.
struct Given {
    held: Vec<Held>,
    notes: Vec<String>,
    evaluations: u64,
    pass_evaluations: u64,
}

impl Shared<'_> {
    /// Runs executions that share a pass, or takes results another process has made meanwhile.
    pub(super) fn execute(&self, jobs: &[Job]) -> Vec<Result<Ended, EngineError>> {
        let (guards, mut ended) = match self.claim(jobs) {
            Ok(claimed) => claimed,
            Err(error) => return self.all_failed(jobs.len(), error),
        };
        let open: Vec<usize> = (0..jobs.len()).filter(|&j| ended[j].is_none()).collect();
        let pass: Vec<&Job> = open.iter().map(|&j| &jobs[j]).collect();
        for (j, end) in open.into_iter().zip(self.compute(&pass)) {
            ended[j] = Some(end);
        }
        drop(guards);
        ended.into_iter().flatten().collect()
    }

    /// Locks the keys, in their order so that no two processes wait for each other, and looks up what
    /// is there by now.
    fn claim(&self, jobs: &[Job]) -> Result<Claimed, EngineError> {
        let cancelled = || self.options.cancelled.load(Ordering::Relaxed);
        let mut keys: Vec<Digest> = jobs.iter().map(|job| job.manifest.key()).collect();
        keys.sort();
        keys.dedup();
        let mut guards = Vec::with_capacity(keys.len());
        for key in keys {
            guards.push(self.store.lock_wait(&key, &cancelled)?.ok_or(EngineError::Cancelled)?);
        }
        let mut ended = Vec::with_capacity(jobs.len());
        for job in jobs {
            let items = &self.plan.executions[job.e].items;
            let held = recorded(&job.manifest, items, self.store);
            let mut there = held.is_some();
            for h in held.iter().flatten() {
                there &= self.store.open_blob(&h.digest, h.bytes)?.is_some();
            }
            let end = |held| Ok(Ended { held, seconds: 0.0, notes: Vec::new(), ran: false });
            ended.push(held.filter(|_| there).map(end));
        }
        Ok((guards, ended))
    }

    fn compute(&self, pass: &[&Job]) -> Vec<Result<Ended, EngineError>> {
        let Some(first) = pass.first() else { return Vec::new() };
        let started = Instant::now();
        self.meter.start(first.e);
        let given = self.run_node(pass);
        let (cpu_seconds, alone) = self.meter.stop(first.e);
        let given = match given {
            Ok(given) => given,
            Err(EngineError::Cancelled) => {
                return self.all_failed(pass.len(), EngineError::Cancelled);
            }
            // So that one that fails takes no other with it.
            Err(_) if pass.len() > 1 => {
                return pass.iter().flat_map(|job| self.compute(&[job])).collect();
            }
            Err(error) => return vec![Err(error)],
        };
        let seconds = started.elapsed().as_secs_f64();
        let record = |(job, given): (&&Job, Given)| {
            // The time of a run by itself is taken to be as its work is to that of the pass.
            let part = match (pass.len(), given.pass_evaluations) {
                (1, _) => 1.0,
                (several, 0) => 1.0 / several as f64,
                (_, all) => given.evaluations as f64 / all as f64,
            };
            let time = Time {
                seconds: seconds * part,
                cpu_seconds: cpu_seconds * part,
                alone: alone && pass.len() == 1,
            };
            self.keep(job, given, time)
        };
        pass.iter().zip(given).map(record).collect()
    }

    /// Writes the records of an execution that has ended well.
    fn keep(&self, job: &Job, given: Given, time: Time) -> Result<Ended, EngineError> {
        let execution = &self.plan.executions[job.e];
        let node = &self.graph.nodes[execution.node];
        let Given { held, notes, evaluations, .. } = given;
        if held.len() != execution.items.len() {
            let (found, expected) = (held.len(), execution.items.len());
            let what = format!("gave {found} items where {expected} were expected");
            return Err(self.failed(job.e, Error::invalid(what)));
        }
        for (item, held) in execution.items.clone().zip(&held) {
            self.store.put_record(&Record {
                manifest: job.manifest.item(item, &execution.items),
                node: node.kind.into(),
                name: node.name.clone(),
                output: held.digest,
                bytes: held.bytes,
                seconds: time.seconds,
                cpu_seconds: time.cpu_seconds,
                alone: time.alone,
                host: self.host.clone(),
                evaluations,
                peak_bytes: peak_bytes(),
                made: SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs()),
                version: env!("CARGO_PKG_VERSION").into(),
                notes: notes.clone(),
            })?;
        }
        self.store.drop_checkpoint(&job.manifest.key())?;
        Ok(Ended { held, seconds: time.seconds, notes, ran: true })
    }

    /// The node itself, for all executions of a pass.
    fn run_node(&self, pass: &[&Job]) -> Result<Vec<Given>, EngineError> {
        let Some(first) = pass.first() else { return Ok(Vec::new()) };
        let node = &self.graph.nodes[self.plan.executions[first.e].node];
        std::thread::scope(|scope| {
            // Progress is handed over by a channel, so that the closure a node holds borrows nothing.
            let (sender, receiver) = std::sync::mpsc::sync_channel::<(usize, u64, u64)>(64);
            scope.spawn(move || {
                for (e, done, total) in receiver {
                    let execution = &self.plan.executions[e];
                    self.progress.step(execution.node, execution.run, done, total);
                }
            });
            let context = |job: &&Job| {
                let (sender, e) = (sender.clone(), job.e);
                let report = Box::new(move |done, total| {
                    // A full channel means that nobody looks so fast: the step is dropped.
                    let _ = sender.try_send((e, done, total));
                });
                let checkpoint = Some(self.store.checkpoint_path(&job.manifest.key()));
                let (cancelled, derived) = (&self.options.cancelled, &self.derived);
                Ctx::new(Arc::clone(cancelled), Arc::clone(derived), report, checkpoint)
            };
            let contexts: Vec<Ctx> = pass.iter().map(context).collect();
            drop(sender);
            let mut held = vec![Vec::new(); pass.len()];
            let runs: Vec<(&Bindings, &Ctx)> =
                pass.iter().map(|job| &job.bindings).zip(&contexts).collect();
            let ran = catch_unwind(AssertUnwindSafe(|| {
                node.node.run(&runs, &mut |run, arrays| {
                    let bytes: usize = arrays.iter().map(|(_, view)| view.bytes.len()).sum();
                    let keep = || -> std::io::Result<_> {
                        let mut writer = self.store.blob_writer(bytes as u64)?;
                        write_arrays(&mut writer, arrays)?;
                        Ok(writer.finish()?)
                    };
                    let (digest, bytes) = keep().map_err(|e| Error::invalid(e.to_string()))?;
                    held[run].push(Held { digest, bytes });
                    Ok(())
                })
            }));
            match ran {
                Ok(Ok(_)) => {
                    let given = held.into_iter().zip(&contexts).map(|(held, ctx)| Given {
                        held,
                        notes: ctx.notes(),
                        evaluations: ctx.evaluations(),
                        pass_evaluations: ctx.pass_evaluations(),
                    });
                    Ok(given.collect())
                }
                Ok(Err(error)) => Err(self.failed(first.e, error)),
                Err(panic) => {
                    let what = format!("an error in the node itself: {}", panic_text(&*panic));
                    Err(self.failed(first.e, Error::invalid(what)))
                }
            }
        })
    }

    fn failed(&self, e: usize, cause: Error) -> EngineError {
        let execution = &self.plan.executions[e];
        let node = &self.graph.nodes[execution.node];
        match cause {
            Error::Cancelled => EngineError::Cancelled,
            cause => EngineError::Node {
                name: node.name.clone(),
                kind: node.kind,
                item: told(node.runs, execution.run),
                cause,
            },
        }
    }

    /// The same end for all executions of a pass; the error itself goes to the first.
    fn all_failed(&self, count: usize, error: EngineError) -> Vec<Result<Ended, EngineError>> {
        let rest = (1..count).map(|_| Err(EngineError::Cancelled));
        std::iter::once(Err(error)).chain(rest).collect()
    }
}

/// Locks, and for each execution how it ended if its result is there already.
type Claimed = (Vec<Guard>, Vec<Option<Result<Ended, EngineError>>>);

/// What an execution took.
#[derive(Clone, Copy)]
struct Time {
    seconds: f64,
    cpu_seconds: f64,
    alone: bool,
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
