//! Toy nodes with known numbers, and how often they ran.

use lightloom::nodes::data::Time;
use lightloom::nodes::node::{All, Ctx, Error, Item, Node, Sequence, Sizes, Window};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// A name for the counters of one test, so that tests side by side do not count each other's runs.
pub fn tag() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

#[derive(Default)]
struct Counts {
    /// Runs by tag.
    runs: BTreeMap<u64, usize>,
    /// Heavy runs under way by tag, and the most there were at a time.
    heavy: BTreeMap<u64, (usize, usize)>,
}

static COUNTS: Mutex<Counts> = Mutex::new(Counts { runs: BTreeMap::new(), heavy: BTreeMap::new() });
static CHANGED: Condvar = Condvar::new();

fn counts() -> MutexGuard<'static, Counts> {
    COUNTS.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// How often nodes of this tag ran.
pub fn runs_of(tag: u64) -> usize {
    counts().runs.get(&tag).copied().unwrap_or(0)
}

/// The most nodes of this tag that ran at a time.
pub fn most_at_once(tag: u64) -> usize {
    counts().heavy.get(&tag).map_or(0, |(_, most)| *most)
}

lightloom_nodes::params! {
    /// a * b + plus, counted.
    pub struct Combine {
        /// Added.
        plus: f64 = 0.0;
        /// Under which its runs are counted.
        tag: u64 = 0;
        /// Milliseconds it takes.
        takes: u64 = 0;
    }
}

lightloom_nodes::inputs! {
    /// Inputs of [`Combine`].
    pub struct CombineIn {
        /// A factor; 1 without it.
        a: Option<Item<Time>>,
        /// Another.
        b: Option<Item<Time>>,
    }
}

impl Node for Combine {
    const KIND: &'static str = "Combine";
    const VERSION: u32 = 1;
    type In = CombineIn;
    type Out = Time;

    fn run(&self, input: CombineIn, _: &Ctx) -> Result<Time, Error> {
        *counts().runs.entry(self.tag).or_default() += 1;
        std::thread::sleep(Duration::from_millis(self.takes));
        let factor = |of: &Option<Item<Time>>| of.as_ref().map_or(1.0, |t| t.seconds);
        Ok(Time { seconds: factor(&input.a) * factor(&input.b) + self.plus })
    }
}

lightloom_nodes::params! {
    /// The sum of a chunk.
    pub struct Total {}
}

lightloom_nodes::inputs! {
    /// Inputs of [`Total`] and [`Running`].
    pub struct WholeIn {
        /// Numbers.
        items: All<Time>,
    }
}

fn numbers(items: &All<Time>) -> Result<Vec<f64>, Error> {
    (0..items.len()).map(|k| items.get(k).map(|t| t.seconds)).collect()
}

impl Node for Total {
    const KIND: &'static str = "Total";
    const VERSION: u32 = 1;
    type In = WholeIn;
    type Out = Time;

    fn run(&self, input: WholeIn, _: &Ctx) -> Result<Time, Error> {
        Ok(Time { seconds: numbers(&input.items)?.iter().sum() })
    }
}

lightloom_nodes::params! {
    /// The running sums of a chunk.
    pub struct Running {
        /// Sums that are missing at the end.
        missing: u32 = 0;
        /// Under which its runs are counted.
        tag: u64 = 0;
    }
}

impl Node for Running {
    const KIND: &'static str = "Running";
    const VERSION: u32 = 1;
    type In = WholeIn;
    type Out = Sequence<Time>;

    fn run(&self, input: WholeIn, _: &Ctx) -> Result<Sequence<Time>, Error> {
        *counts().runs.entry(self.tag).or_default() += 1;
        let mut sum = 0.0;
        let add = |number: f64| {
            sum += number;
            Time { seconds: sum }
        };
        let mut items: Vec<Time> = numbers(&input.items)?.into_iter().map(add).collect();
        items.truncate(items.len().saturating_sub(self.missing as usize));
        Ok(Sequence { items, chunk: 1 })
    }
}

lightloom_nodes::params! {
    /// From a number to the next.
    pub struct Step {}
}

lightloom_nodes::inputs! {
    /// Inputs of [`Step`].
    pub struct StepIn {
        /// Numbers.
        items: Window<Time>,
    }
}

impl Node for Step {
    const KIND: &'static str = "Step";
    const VERSION: u32 = 1;
    type In = StepIn;
    type Out = Time;

    fn run(&self, input: StepIn, _: &Ctx) -> Result<Time, Error> {
        Ok(Time { seconds: input.items.next.seconds - input.items.this.seconds })
    }
}

lightloom_nodes::choice! {
    /// What goes wrong.
    pub enum Wrong {
        /// An error.
        Error = "error",
        /// A panic.
        Panic = "panic",
        /// It does not end before it is cancelled.
        Endless = "endless",
    }
}

lightloom_nodes::params! {
    /// Passes a number on, or does not.
    pub struct Trouble {
        /// The number at which it goes wrong.
        at: f64 = -1.0;
        /// How.
        how: Wrong = Wrong::Error;
    }
}

lightloom_nodes::inputs! {
    /// Inputs of [`Trouble`].
    pub struct TroubleIn {
        /// A number.
        a: Item<Time>,
    }
}

impl Node for Trouble {
    const KIND: &'static str = "Trouble";
    const VERSION: u32 = 1;
    type In = TroubleIn;
    type Out = Time;

    fn run(&self, input: TroubleIn, ctx: &Ctx) -> Result<Time, Error> {
        let seconds = input.a.seconds;
        match self.how {
            _ if seconds != self.at => Ok(Time { seconds }),
            Wrong::Error => Err(Error::invalid(format!("{seconds} is what I was afraid of"))),
            Wrong::Panic => panic!("{seconds} is a bug"),
            Wrong::Endless => loop {
                ctx.tick(0, 1)?;
                std::thread::sleep(Duration::from_millis(1));
            },
        }
    }
}

lightloom_nodes::params! {
    /// Passes a number on, and says that it needs much memory.
    pub struct Heavy {
        /// Bytes.
        bytes: u64 = 0;
        /// Milliseconds for which it waits for another one of its tag.
        waits: u64 = 0;
        /// Under which its runs are counted.
        tag: u64 = 0;
    }
}

impl Node for Heavy {
    const KIND: &'static str = "Heavy";
    const VERSION: u32 = 1;
    type In = TroubleIn;
    type Out = Time;

    fn memory(&self, _: &Sizes) -> u64 {
        self.bytes
    }

    fn run(&self, input: TroubleIn, _: &Ctx) -> Result<Time, Error> {
        let end = Instant::now() + Duration::from_millis(self.waits);
        let mut counts = counts();
        let (now, most) = counts.heavy.entry(self.tag).or_default();
        *now += 1;
        *most = (*most).max(*now);
        CHANGED.notify_all();
        while counts.heavy[&self.tag].1 < 2 {
            let Some(left) = end.checked_duration_since(Instant::now()).filter(|d| !d.is_zero())
            else {
                break;
            };
            counts = CHANGED
                .wait_timeout(counts, left)
                .unwrap_or_else(|poisoned| poisoned.into_inner())
                .0;
        }
        if let Some((now, _)) = counts.heavy.get_mut(&self.tag) {
            *now -= 1;
        }
        Ok(Time { seconds: input.a.seconds })
    }
}
