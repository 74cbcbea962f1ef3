//! The frames of a shot: the one source of sequences.

use crate::data::Time;
use crate::node::{Ctx, Error, Node, Problems, Sequence};

crate::params! {
    /// Makes a shot of what follows: every node that takes its times runs once for each frame, and nodes
    /// that take whole sequences once for each chunk.
    pub struct Frames {
        /// First frame.
        first: u32 = 0;
        /// Last frame, included.
        last: u32 = 39;
        /// Frames a second.
        fps: f64 = 20.0, 0.001..=100_000.0;
        /// Frames that are clustered together; the paper's chunks have 40. Each chunk has its own
        /// clusters, so memory depends on the chunk, not on the shot.
        chunk: u32 = 40, 1..=1000;
    }
}

impl Node for Frames {
    const KIND: &'static str = "Frames";
    const VERSION: u32 = 1;
    type In = ();
    type Out = Sequence<Time>;

    fn check(&self, problems: &mut Problems) {
        if self.last < self.first {
            problems.report("last", format!("expected at least `first`, {}, found {}", self.first, self.last));
        }
        if self.last.saturating_sub(self.first) >= 100_000 {
            problems.report("last", "expected at most 100000 frames");
        }
    }

    fn run(&self, (): (), _: &Ctx) -> Result<Sequence<Time>, Error> {
        let time = |frame: u32| Time { seconds: f64::from(frame) / self.fps };
        Ok(Sequence { items: (self.first..=self.last).map(time).collect(), chunk: self.chunk as usize })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_times_in_seconds() {
        let shot = Frames { first: 10, last: 12, fps: 20.0, chunk: 2 }.run((), &Ctx::default()).unwrap();
        let seconds: Vec<f64> = shot.items.iter().map(|t| t.seconds).collect();
        assert_eq!((seconds, shot.chunk), (vec![0.5, 0.55, 0.6], 2));
    }
}
