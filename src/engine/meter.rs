//! Processor time of executions that may run side by side.

use cpu_time::ProcessTime;
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard};

/// Shares the processor time of the process out among the passes under way. The threads of the pool
/// work for all of them, so that the system cannot tell whose time it was: equal shares are taken
/// wherever several ran at once, and such passes are marked.
pub struct Meter(Mutex<Shares>);

struct Shares {
    /// Processor seconds up to which everything is shared out.
    counted: f64,
    /// Seconds of each pass so far, and whether it was alone all the time.
    passes: BTreeMap<usize, (f64, bool)>,
}

impl Meter {
    /// Nothing under way.
    pub fn new() -> Self {
        Meter(Mutex::new(Shares { counted: now(), passes: BTreeMap::new() }))
    }

    /// A pass begins.
    pub fn start(&self, pass: usize) {
        let mut shares = self.share(now());
        shares.passes.insert(pass, (0.0, true));
        let alone = shares.passes.len() == 1;
        shares.passes.values_mut().for_each(|(_, own)| *own &= alone);
    }

    /// A pass ends: its processor seconds, and whether it was alone all the time.
    pub fn stop(&self, pass: usize) -> (f64, bool) {
        self.share(now()).passes.remove(&pass).unwrap_or((0.0, true))
    }

    fn share(&self, now: f64) -> MutexGuard<'_, Shares> {
        let mut shares = self.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let part = (now - shares.counted).max(0.0) / shares.passes.len().max(1) as f64;
        shares.passes.values_mut().for_each(|(seconds, _)| *seconds += part);
        shares.counted = now;
        shares
    }
}

fn now() -> f64 {
    ProcessTime::now().as_duration().as_secs_f64()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(meter: &Meter, seconds: f64) -> MutexGuard<'_, Shares> {
        meter.share(seconds)
    }

    #[test]
    fn time_is_shared_out_and_nothing_is_lost() {
        let meter = Meter(Mutex::new(Shares { counted: 10.0, passes: BTreeMap::new() }));
        at(&meter, 12.0).passes.insert(1, (0.0, true));
        at(&meter, 15.0).passes.insert(2, (0.0, false));
        drop(at(&meter, 17.0));
        let passes = at(&meter, 17.0).passes.clone();
        assert_eq!(passes, BTreeMap::from([(1, (4.0, true)), (2, (1.0, false))]));
    }

    #[test]
    fn only_who_was_alone_all_the_time_is_told_so() {
        let meter = Meter::new();
        meter.start(1);
        assert!(meter.stop(1).1);
        meter.start(2);
        meter.start(3);
        assert!(!meter.stop(3).1 && !meter.stop(2).1);
        meter.start(4);
        assert!(meter.stop(4).1);
    }
}
