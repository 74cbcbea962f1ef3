//! How much memory building a quantized tree takes at its peak, counted by the allocator.
//!
//! A test of its own program: the allocator counts for all threads.

use glam::Vec3;
use lightloom_nodes::data::{Data, Lut, PbgiTree, RadiantSurfels, encode};
use lightloom_nodes::kernel::pbgi::learning::of_nodes;
use lightloom_nodes::kernel::pbgi::stored::{Recipe, Shape, build};
use lightloom_nodes::kernel::pbgi::stream::{Average, dimensions};
use lightloom_nodes::kernel::pbgi::tree::looks::Format;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The system's allocator, counting.
struct Counting;

static NOW: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is handed to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let now = NOW.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        PEAK.fetch_max(now, Ordering::Relaxed);
        // SAFETY: the caller's promises are those of the system's allocator.
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        let now = NOW.fetch_add(size, Ordering::Relaxed) + size;
        PEAK.fetch_max(now - layout.size().min(size), Ordering::Relaxed);
        NOW.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as above.
        unsafe { System.realloc(place, layout, size) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as above.
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

const SURFELS: usize = 400_000;

/// Surfels all over a ball of many small colours.
fn ball() -> RadiantSurfels {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let normals: Vec<Vec3> = (0..SURFELS)
        .map(|_| {
            let mut number = || random.random::<f32>() * 2.0 - 1.0;
            Vec3::new(number(), number(), number()).normalize_or(Vec3::Y)
        })
        .collect();
    RadiantSurfels {
        position: normals.iter().map(|n| n * 3.0).collect(),
        radiance: normals.iter().map(|n| n.abs()).collect(),
        area: vec![1e-4; SURFELS].into(),
        radius: vec![0.01; SURFELS].into(),
        normal: normals.into(),
    }
}

fn bytes<T: Data>(artifact: &T) -> usize {
    encode(artifact).len()
}

#[test]
fn a_quantized_build_stays_near_its_surfels_and_its_result() {
    let surfels = ball();
    let input = bytes(&surfels);
    let entries = of_nodes(&surfels, Shape::Binary, Average::Area, 3, 100);
    let rows = entries.len() / dimensions(3);
    let entries = lightloom_nodes::data::Array::shaped(entries, &[rows, dimensions(3)]);
    let lut = Lut { entries, bands: 3, balance: 1.0 };
    for format in [Format::A, Format::B, Format::C] {
        let recipe = Recipe { shape: Shape::Binary, average: Average::Area, format, bands: 3 };
        let before = NOW.load(Ordering::Relaxed);
        PEAK.store(before, Ordering::Relaxed);
        let (tree, _) = build(&surfels, recipe, Some(&lut)).expect("a tree");
        let peak = PEAK.load(Ordering::Relaxed) - before;
        let result = bytes::<PbgiTree>(&tree);
        // Format C is so small that sorting, 36 bytes a surfel, is more than it.
        let share = if format == Format::C { 1.35 } else { 1.3 };
        let most = share * (input + result) as f64;
        let all = (input + peak) as f64;
        println!("{format:?}: surfels {input}, result {result}, beside the surfels {peak}");
        assert!(all <= most, "{format:?}: {all} bytes at the peak, {most} allowed");
    }
}
