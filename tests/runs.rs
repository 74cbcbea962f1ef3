//! Runs through the library: how they fail, stop, and share work, and how sequences and memory count.

use crate::workspace::{Silent, Workspace, most_at_once, options, runs_of, tag};
use lightloom::engine::{EngineError, Options, Progress};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Five frames in chunks of two; the times are 0, 1, 2, 3, 4.
fn toys(nodes: &str) -> Workspace {
    let frames = "\"frames\": Frames(last: 4, fps: 1, chunk: 2),";
    Workspace::new(&format!("#![enable(implicit_some)]\nGraph(nodes: {{ {frames} {nodes} }})"))
}

/// Stops a run from one of its callbacks.
#[derive(Default)]
struct Stops {
    cancelled: Arc<AtomicBool>,
    /// Executions that may still end before it stops.
    ends: AtomicUsize,
    /// Whether the first step stops it.
    at_step: bool,
}

impl Progress for Stops {
    fn start(&self, _: usize, _: &str, _: usize, _: usize) {}
    fn step(&self, _: usize, _: usize, _: u64, _: u64) {
        if self.at_step {
            self.cancelled.store(true, Ordering::Relaxed);
        }
    }
    fn end(&self, _: usize, _: usize) {
        if self.ends.fetch_sub(1, Ordering::Relaxed) == 1 {
            self.cancelled.store(true, Ordering::Relaxed);
        }
    }
}

#[test]
fn a_node_that_fails_is_named_and_the_results_of_others_are_kept() {
    let toys = toys(
        r#""first": Combine(a: "frames"), "flaky": Trouble(a: "first", at: 2), "last": Combine(a: "flaky", plus: 1),"#,
    );
    let error = toys.run_nodes(&[], &["last"]).err().unwrap();
    assert_eq!(error.to_string(), "flaky (Trouble, frame 2) failed: 2 is what I was afraid of");
    assert!(matches!(error, EngineError::Node { .. }));
    let repaired = toys.run_nodes(&["flaky.at=-1"], &["last"]).unwrap();
    assert_eq!(
        (repaired.ran("first"), repaired.ran("flaky"), repaired.ran("last")),
        ((2, 5), (5, 5), (3, 5))
    );
    assert_eq!(repaired.numbers("last"), [1.0, 2.0, 3.0, 4.0, 5.0]);
}

#[test]
fn a_node_that_panics_is_an_error() {
    let toys =
        toys(r#""flaky": Trouble(a: "frames", at: 2, how: panic), "last": Combine(a: "flaky"),"#);
    for jobs in [1, 2] {
        let error =
            toys.attempt(&[], &["last"], &Options { jobs, ..options() }, &Silent).err().unwrap();
        let text = error.to_string();
        assert!(
            text.starts_with("flaky (Trouble, frame 2) failed: ") && text.contains("2 is a bug"),
            "{text}"
        );
    }
    assert_eq!(toys.run_nodes(&["flaky.at=-1"], &["last"]).unwrap().numbers("last").len(), 5);
}

#[test]
fn a_failure_leaves_the_options_of_the_caller_alone() {
    let toys = toys(r#""flaky": Trouble(a: "frames", at: 2),"#);
    let options = options();
    assert!(toys.attempt(&[], &["flaky"], &options, &Silent).is_err());
    assert!(!options.cancelled.load(Ordering::Relaxed), "nobody asked the run to stop");
    assert_eq!(
        toys.attempt(&["flaky.at=-1"], &["flaky"], &options, &Silent)
            .unwrap()
            .numbers("flaky")
            .len(),
        5
    );
}

#[test]
fn a_failure_stops_what_runs_beside_it() {
    let toys = toys(
        r#""flaky": Trouble(a: "frames", at: 1), "endless": Trouble(a: "frames", at: 0, how: endless),"#,
    );
    let error = toys
        .attempt(&[], &["flaky", "endless"], &Options { jobs: 2, ..options() }, &Silent)
        .err()
        .unwrap();
    assert_eq!(error.to_string(), "flaky (Trouble, frame 1) failed: 1 is what I was afraid of");
}

#[test]
fn a_run_that_is_stopped_goes_on_where_it_was() {
    let tag = tag();
    let toys =
        toys(&format!(r#""slow": Combine(a: "frames", tag: {tag}), "last": Combine(a: "slow"),"#));
    // The frames, and slow and last of frame 0 and 1.
    let stops = Stops { ends: AtomicUsize::new(5), ..Stops::default() };
    let options = Options { cancelled: Arc::clone(&stops.cancelled), ..options() };
    let error = toys.attempt(&[], &["last"], &options, &stops).err().unwrap();
    assert!(matches!(error, EngineError::Cancelled));
    assert_eq!(runs_of(tag), 2);
    let rest = toys.run_nodes(&[], &["last"]).unwrap();
    assert_eq!((rest.ran("slow"), rest.ran("last"), runs_of(tag)), ((3, 5), (3, 5), 5));
}

#[test]
fn a_node_under_way_is_stopped_too() {
    let toys = toys(r#""endless": Trouble(a: "frames", at: 0, how: endless),"#);
    let stops = Stops { at_step: true, ..Stops::default() };
    let options = Options { cancelled: Arc::clone(&stops.cancelled), ..options() };
    let error = toys.attempt(&[], &["endless"], &options, &stops).err().unwrap();
    assert!(matches!(error, EngineError::Cancelled));
    assert_eq!(toys.run_nodes(&["endless.at=-1"], &["endless"]).unwrap().ran("endless"), (5, 5));
}

#[test]
fn two_runs_of_one_graph_compute_each_key_once() {
    let tag = tag();
    let toys = toys(&format!(
        r#""slow": Combine(a: "frames", tag: {tag}, takes: 10), "sums": Running(items: "slow", tag: {tag}),
           "last": Combine(a: "sums", b: "slow", tag: {tag}, takes: 5),"#
    ));
    let run = || {
        let options = Options { jobs: 2, ..options() };
        toys.attempt(&[], &["last"], &options, &Silent).unwrap()
    };
    let (one, two) = std::thread::scope(|scope| {
        let other = scope.spawn(run);
        (run(), other.join().unwrap())
    });
    // Sums of chunks: 0 1 | 2 5 | 4.
    assert_eq!(one.numbers("last"), [0.0, 1.0, 4.0, 15.0, 16.0]);
    assert_eq!(one.held("last"), two.held("last"));
    assert_eq!(runs_of(tag), 5 + 3 + 5);
    assert_eq!(one.summary.ran().0 + two.summary.ran().0, 1 + 5 + 3 + 5);
}

#[test]
fn equal_executions_of_one_run_are_computed_once() {
    let tag = tag();
    // The number 7 in every frame, and by two nodes.
    let toys = toys(&format!(
        r#""zero": Combine(plus: 0), "same": Combine(a: "frames", b: "zero", plus: 7),
           "one": Combine(a: "same", tag: {tag}), "two": Combine(a: "same", tag: {tag}),"#
    ));
    toys.edit("\"zero\": Combine(plus: 0)", "\"zero\": Combine(plus: -1)");
    for jobs in [1, 3] {
        let ran =
            toys.attempt(&[], &["one", "two"], &Options { jobs, ..options() }, &Silent).unwrap();
        assert_eq!((ran.numbers("one"), ran.numbers("two")), (vec![7.0; 5], vec![7.0; 5]));
        assert_eq!(runs_of(tag), 1);
    }
}

#[test]
fn a_wrong_number_of_items_is_an_error() {
    let toys = toys(r#""sums": Running(items: "frames", missing: 1),"#);
    let error = toys.run_nodes(&[], &["sums"]).err().unwrap().to_string();
    assert_eq!(error, "sums (Running, chunk 0) failed: gave 1 items where 2 were expected");
    assert_eq!(
        toys.run_nodes(&["sums.missing=0"], &["sums"]).unwrap().numbers("sums"),
        [0.0, 1.0, 2.0, 5.0, 4.0]
    );
}

#[test]
fn sequences_have_known_numbers() {
    let toys = toys(
        r#""seven": Combine(plus: 6),
           "scaled": Combine(a: "frames", b: "seven"),
           "squares": Combine(a: "frames", b: "frames"),
           "steps": Step(items: "squares"),
           "doubled": Combine(a: "steps", plus: 1),
           "totals": Total(items: "squares"),
           "step_totals": Total(items: "steps"),
           "after": Combine(a: "totals", b: "step_totals", plus: 0.5),
           "sums": Running(items: "squares"),
           "both": Combine(a: "sums", b: "frames"),
           "single": Total(items: "seven"),"#,
    );
    let wanted =
        ["scaled", "steps", "doubled", "totals", "step_totals", "after", "sums", "both", "single"];
    let ran = toys.run_nodes(&[], &wanted).unwrap();
    let expected: [&[f64]; 9] = [
        &[0.0, 7.0, 14.0, 21.0, 28.0],
        // Frames 0 and 1, 2 and 3; the last chunk has no pair, and none reaches across.
        &[1.0, 5.0],
        &[2.0, 6.0],
        // 0 + 1, 4 + 9, 16.
        &[1.0, 13.0, 16.0],
        &[1.0, 5.0, 0.0],
        &[1.5, 65.5, 0.5],
        &[0.0, 1.0, 4.0, 13.0, 16.0],
        &[0.0, 1.0, 8.0, 39.0, 64.0],
        &[7.0],
    ];
    for (node, numbers) in wanted.iter().zip(expected) {
        assert_eq!(ran.numbers(node), numbers, "{node}");
    }
    assert_eq!((ran.ran("squares"), ran.ran("steps"), ran.ran("sums")), ((5, 5), (2, 2), (3, 3)));

    // A chunk less, and other chunks of the same frames.
    let ran = toys.run_nodes(&["frames.last=3"], &wanted).unwrap();
    assert_eq!((ran.ran("squares"), ran.ran("totals"), ran.ran("sums")), ((0, 4), (0, 2), (0, 2)));
    let ran = toys.run_nodes(&["frames.chunk=3"], &wanted).unwrap();
    assert_eq!((ran.ran("scaled"), ran.ran("steps"), ran.ran("totals")), ((0, 5), (2, 3), (2, 2)));
    assert_eq!(
        (ran.numbers("steps"), ran.numbers("totals")),
        (vec![1.0, 3.0, 7.0], vec![5.0, 25.0])
    );
}

#[test]
fn estimates_beyond_the_limit_never_run_side_by_side() {
    let run = |memory: u64, bytes: u64, waits: u64| {
        let tag = tag();
        let toys = toys(&format!(
            r#""heavy": Heavy(a: "frames", bytes: {bytes}, waits: {waits}, tag: {tag}),"#
        ));
        let options = Options { jobs: 4, memory, ..options() };
        toys.attempt(&[], &["heavy"], &options, &Silent).unwrap();
        most_at_once(tag)
    };
    assert_eq!(run(1000, 600, 40), 1);
    // More than the limit by itself: alone.
    assert_eq!(run(1000, 5000, 40), 1);
    assert!(run(1000, 400, 5000) >= 2);
}

#[test]
fn extreme_estimates_do_not_overflow() {
    let tag = tag();
    let toys = toys(&format!(
        r#""huge": Heavy(a: "frames", bytes: 18446744073709551615, waits: 20, tag: {tag}), "small": Combine(a: "frames", takes: 5),"#
    ));
    let options = Options { jobs: 3, memory: u64::MAX, ..options() };
    let ran = toys.attempt(&[], &["huge", "small"], &options, &Silent).unwrap();
    assert_eq!((ran.ran("huge"), ran.ran("small")), ((5, 5), (5, 5)));
}
