//! Clustering of a reduced tensor of the size of the paper's (100 rows, 65,536 lights, 40 frames: 1.05 GB), beside the time
//! that reading it once takes, which no clustering can do without: `cargo bench -p lightloom-nodes --bench clustering`.
//! Processor time of one thread and of two.

use cpu_time::ProcessTime;
use lightloom_nodes::kernel::clustering::{Error, Settings, Tensor, cluster_tensor};
use std::hint::black_box;
use std::time::Instant;

/// Extents of the tensor.
const ROWS: usize = 100;
const LIGHTS: usize = 65_536;
const FRAMES: usize = 40;
/// Clusters in the beginning and in the end, 200 a frame.
const START: usize = 100;
const LIMIT: usize = 8000;
/// Rounds, of which the fastest counts.
const ROUNDS: usize = 3;

fn main() {
    let tensor = tensor().expect("the tensor is valid");
    let read = (0..ROUNDS).map(|_| seconds(|| read(&tensor))).fold(f64::INFINITY, f64::min);
    let bytes = (4 * ROWS * LIGHTS * FRAMES) as f64;
    println!("one read of {:.2} GB: {read:.3} s, {:.1} GB/s", bytes * 1e-9, bytes * 1e-9 / read);
    let mut walls = Vec::new();
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let least = |limit: usize| {
            (0..ROUNDS)
                .map(|_| {
                    let wall = Instant::now();
                    let cpu = seconds(|| pool.install(|| cluster(&tensor, limit)));
                    (cpu, wall.elapsed().as_secs_f64())
                })
                .fold((f64::INFINITY, f64::INFINITY), |a, b| (a.0.min(b.0), a.1.min(b.1)))
        };
        let (start, _) = least(START);
        let (all, wall) = least(LIMIT);
        let splits = all - start;
        println!(
            "{threads} threads: {START} clusters {start:.2} s, from there to {LIMIT} {splits:.2} s, {:.1} reads; all in {wall:.2} s",
            splits / read
        );
        walls.push(wall);
    }
    println!("two threads are {:.2} times as fast as one", walls[0] / walls[1]);
}

/// Processor seconds of the process.
fn seconds<T>(work: impl FnOnce() -> T) -> f64 {
    let start = ProcessTime::now();
    black_box(work());
    start.elapsed().as_secs_f64()
}

/// Every number once, in order.
fn read(tensor: &Tensor) -> u32 {
    let slab = |light| tensor.slab(light, 0..FRAMES).iter();
    (0..LIGHTS).flat_map(slab).fold(0, |sum, value| sum ^ value.to_bits())
}

fn cluster(tensor: &Tensor, limit: usize) -> usize {
    let settings = Settings { start: START, limit, time_weight: 1.0, seed: 1, cuts: &[] };
    let history = cluster_tensor::<Error>(tensor, &settings, &|_, _| Ok(()));
    history.expect("the tensor can be clustered").max_count()
}

/// Lights on a plane over rows on a plane, a cosine over the squared distance; a third of them in a moving shadow.
fn tensor() -> Result<Tensor, Error> {
    let side = (LIGHTS as f32).sqrt();
    Tensor::from_frames(LIGHTS, ROWS, FRAMES, |frame| {
        let time = frame as f32 / FRAMES as f32;
        let element = |light: usize, row: usize| {
            let (x, y) = ((light as f32 % side) / side, (light as f32 / side).floor() / side);
            let (u, v) = ((row % 10) as f32 * 0.1, (row / 10) as f32 * 0.1);
            let (dx, dy) = (x - u - 0.1 * time, y - v);
            let lit = (7.0 * x + 5.0 * u + 3.0 * y * v + time).fract() > 0.33;
            if lit { 1.0 / (dx * dx + dy * dy + 0.05) } else { 0.0 }
        };
        let values = (0..LIGHTS * ROWS).map(|i| element(i / ROWS, i % ROWS));
        Ok::<Vec<f32>, Error>(values.collect())
    })
}
