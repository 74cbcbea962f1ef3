//! Visibility kernels beside Embree 4, in one run: `cargo bench -p lightloom-nodes --bench visibility`.
//!
//! `LIGHTLOOM_EMBREE` names the shared library of Embree 4; without it only the own kernels are timed. `-- --quick`
//! takes fewer rounds, and a word as in `-- trees` leaves out the scenes that have not got it in their name. Engines take turns within each round; figures are the least over
//! the rounds of the calling thread's CPU time, and include filling the engine's ray structures.

mod embree;
mod rays;
mod scenes;

use cpu_time::{ProcessTime, ThreadTime};
use embree::{Embree, EmbreeScene, Quality};
use glam::Vec3;
use lightloom_nodes::kernel::visibility::{Blas, Blocker, Build, Ends, Instance, World};
use rays::{Found, Points, Rays, found};
use scenes::Scene;
use std::sync::Arc;
use std::time::Duration;

fn main() {
    let quick = std::env::args().any(|argument| argument == "--quick");
    let wanted = std::env::args().skip(1).find(|argument| !argument.starts_with('-'));
    let embree = match std::env::var("LIGHTLOOM_EMBREE") {
        Ok(path) => match Embree::open(&path) {
            Ok(embree) => Some(embree),
            Err(error) => {
                println!("EMBREE IS ABSENT, nothing is compared: {path}: {error}");
                None
            }
        },
        Err(_) => {
            println!(
                "EMBREE IS ABSENT, nothing is compared. To compare: `pip download --no-deps embreex`, unzip the \
                 wheel, and set LIGHTLOOM_EMBREE to embreex.libs/libembree4-*.so.4 in it."
            );
            None
        }
    };
    if let Some(embree) = &embree {
        println!("Embree {}", embree.version());
    }
    let rounds = if quick { 3 } else { 7 };
    type Make = fn(&'static str) -> Scene;
    let scenes: [(&str, Make); 3] = [
        ("atrium", |name| scenes::atrium(name, 1.1)),
        ("large", |name| scenes::atrium(name, 3.0)),
        ("trees", scenes::trees),
    ];
    for (name, make) in scenes {
        if wanted.as_ref().is_none_or(|word| name.contains(word.as_str())) {
            measure(&make(name), embree.as_ref(), rounds);
        }
    }
}

fn measure(scene: &Scene, embree: Option<&Embree>, rounds: usize) {
    println!("\n{}: {} triangles", scene.name, scene.triangles());
    builds(scene, embree, rounds.min(3));
    let world = world(scene, Build::Medium);
    let other = embree.map(|embree| embree.build(scene, Quality::Medium));
    let points = Points::of(scene, &world);
    shadows("columns", &points.columns(), (scene, &world), other.as_ref(), rounds);
    shadows("rows", &points.rows(), (scene, &world), other.as_ref(), rounds);
    shadows("incoherent", &points.incoherent(), (scene, &world), other.as_ref(), rounds);
    nearest("primary, closest", points.primary(), (&world, true), other.as_ref(), rounds);
    nearest("bounces, closest", &points.bounces(), (&world, false), other.as_ref(), rounds);
}

fn world(scene: &Scene, build: Build) -> World {
    let meshes: Vec<Arc<Blas>> =
        scene.meshes.iter().map(|mesh| Arc::new(Blas::new(mesh, &[], build))).collect();
    let mut first_triangle = 0;
    let instances = scene.places.iter().map(|&(mesh, to_world)| {
        let instance = Instance { blas: meshes[mesh].clone(), to_world, first_triangle };
        first_triangle += scene.meshes[mesh].len() as u32;
        instance
    });
    World::new(instances.collect())
}

/// The least of some times: whatever else the machine does can only add to it.
fn least(times: Vec<Duration>) -> f64 {
    times.into_iter().min().unwrap_or(Duration::MAX).as_secs_f64()
}

/// CPU seconds to build all of a scene.
fn builds(scene: &Scene, embree: Option<&Embree>, rounds: usize) {
    let mut times = vec![Vec::new(); 4];
    for _ in 0..rounds {
        let mut clock = |slot: usize, build: &mut dyn FnMut()| {
            // Of the whole process: a builder may bring threads of its own.
            let start = ProcessTime::now();
            build();
            times[slot].push(start.elapsed());
        };
        clock(0, &mut || drop(world(scene, Build::Fast)));
        clock(1, &mut || drop(world(scene, Build::Medium)));
        if let Some(embree) = embree {
            clock(2, &mut || drop(embree.build(scene, Quality::Low)));
            clock(3, &mut || drop(embree.build(scene, Quality::Medium)));
        }
    }
    let names = ["own fast", "own medium", "Embree low", "Embree medium"];
    let seconds: Vec<Option<f64>> =
        times.into_iter().map(|times| (!times.is_empty()).then(|| least(times))).collect();
    let reference = seconds[3];
    for (name, seconds) in names.iter().zip(seconds) {
        let Some(seconds) = seconds else { continue };
        let ratio =
            reference.map_or(String::new(), |r| format!("   {:5.2} x Embree medium", seconds / r));
        println!("  build {name:14} {seconds:8.4} s{ratio}");
    }
}

/// An engine: its name and what traces all rays.
type Engine<'a, T> = (String, Box<dyn Fn(&Rays, &mut [T]) + 'a>);

/// Times each engine and gives Mrays/s and the answers.
fn race<T: Clone>(
    rays: &Rays,
    nothing: T,
    engines: &[Engine<T>],
    rounds: usize,
) -> Vec<(f64, Vec<T>)> {
    let mut times = vec![Vec::new(); engines.len()];
    let mut answers = vec![vec![nothing; rays.len()]; engines.len()];
    for _ in 0..rounds {
        for (((_, trace), times), answers) in engines.iter().zip(&mut times).zip(&mut answers) {
            let start = ThreadTime::now();
            trace(rays, answers);
            times.push(start.elapsed());
        }
    }
    times.into_iter().map(|t| rays.len() as f64 / least(t) / 1e6).zip(answers).collect()
}

fn shadows(
    what: &str,
    rays: &Rays,
    (scene, world): (&Scene, &World),
    embree: Option<&EmbreeScene>,
    rounds: usize,
) {
    let mut engines: Vec<Engine<bool>> = Vec::new();
    if !rays.runs.is_empty() {
        let trace = |rays: &Rays, blocked: &mut [bool]| packets(world, rays, blocked);
        engines.push(("own packets".into(), Box::new(trace)));
    }
    let trace = |rays: &Rays, blocked: &mut [bool]| {
        for (i, blocked) in blocked.iter_mut().enumerate() {
            *blocked = world.occluded(rays.start(i), rays.end(i), &|_, _, _| true);
        }
    };
    engines.push(("own single".into(), Box::new(trace)));
    let own = engines.len();
    if let Some(embree) = embree {
        let single = |rays: &Rays, blocked: &mut [bool]| embree.occluded1(rays, blocked);
        engines.push(("rtcOccluded1".into(), Box::new(single)));
        for coherent in [false, true] {
            let of =
                |width: usize| format!("rtcOccluded{width}{}", if coherent { " c" } else { "" });
            engines.push((
                of(4),
                Box::new(move |rays, blocked| embree.occluded_n::<4>(rays, coherent, blocked)),
            ));
            engines.push((
                of(8),
                Box::new(move |rays, blocked| embree.occluded_n::<8>(rays, coherent, blocked)),
            ));
            engines.push((
                of(16),
                Box::new(move |rays, blocked| embree.occluded_n::<16>(rays, coherent, blocked)),
            ));
        }
    }
    let results = race(rays, false, &engines, rounds);
    let share = |of: usize, with: usize| {
        let pairs = results[of].1.iter().zip(&results[with].1);
        pairs.filter(|(a, b)| a != b).count() as f64 / rays.len() as f64
    };
    let blocked = results[0].1.iter().filter(|b| **b).count() as f64 / rays.len() as f64;
    println!("  {what}: {} rays, {:.0} % blocked", rays.len(), 100.0 * blocked);
    let best = results[own..].iter().map(|r| r.0).fold(0.0, f64::max);
    for (i, ((name, _), (speed, _))) in engines.iter().zip(&results).enumerate() {
        print!("    {name:14} {speed:7.2} Mrays/s");
        if i < own {
            if own < engines.len() {
                print!(
                    "   {:5.2} x best, {:5.2} x rtcOccluded1",
                    speed / best,
                    speed / results[own].0
                );
                print!(", {:.1e} differ from it", share(i, own));
            }
            if i + 1 < own {
                print!(", {:.1e} from single", share(i, own - 1));
            }
        } else if i > own {
            print!("   {:.1e} differ from rtcOccluded1", share(i, own));
        }
        println!();
    }
    if own < engines.len() {
        let (ours, theirs) = (&results[own - 1].1, &results[own].1);
        let differ: Vec<usize> =
            (0..rays.len()).filter(|&i| ours[i] != theirs[i]).take(20).collect();
        let right = differ
            .iter()
            .filter(|&&i| rays::blocked(scene, rays.start(i), rays.end(i)) == ours[i])
            .count();
        println!("    in double precision own is right in {right} of {} such rays", differ.len());
    }
}

/// Each run of rays in packets of 64.
fn packets(world: &World, rays: &Rays, blocked: &mut [bool]) {
    let mut ends = Ends::new();
    for (shared, run) in &rays.runs {
        let mut blocker = Blocker::default();
        for first in run.clone().step_by(Ends::CAPACITY) {
            let count = (run.end - first).min(Ends::CAPACITY);
            ends.xs[..count].copy_from_slice(&rays.end[0][first..][..count]);
            ends.ys[..count].copy_from_slice(&rays.end[1][first..][..count]);
            ends.zs[..count].copy_from_slice(&rays.end[2][first..][..count]);
            let active = u64::MAX >> (Ends::CAPACITY - count);
            let bits = world.occluded_from(*shared, &ends, active, &mut blocker, &|_, _, _| true);
            for (i, blocked) in blocked[first..][..count].iter_mut().enumerate() {
                *blocked = bits >> i & 1 != 0;
            }
        }
    }
}

/// Rays that all share their origin, in packets of 64.
fn nearest_packets(world: &World, rays: &Rays, hits: &mut [Found]) {
    let limits = [[0.0; Ends::CAPACITY], [f32::INFINITY; Ends::CAPACITY]];
    let mut ways = Ends::new();
    for (chunk, hits) in hits.chunks_mut(Ends::CAPACITY).enumerate() {
        let first = chunk * Ends::CAPACITY;
        ways.xs[..hits.len()].copy_from_slice(&rays.direction[0][first..][..hits.len()]);
        ways.ys[..hits.len()].copy_from_slice(&rays.direction[1][first..][..hits.len()]);
        ways.zs[..hits.len()].copy_from_slice(&rays.direction[2][first..][..hits.len()]);
        let active = u64::MAX >> (Ends::CAPACITY - hits.len());
        let seen = world.closest_from(rays.start(0), &ways, active, &limits, &|_, _, _| true);
        hits.iter_mut().zip(seen).for_each(|(hit, seen)| *hit = found(seen));
    }
}

fn nearest(
    what: &str,
    rays: &Rays,
    (world, share_origin): (&World, bool),
    embree: Option<&EmbreeScene>,
    rounds: usize,
) {
    let trace = |rays: &Rays, hits: &mut [Found]| {
        for (i, hit) in hits.iter_mut().enumerate() {
            let (start, way): (Vec3, Vec3) = (rays.start(i), rays.way(i));
            *hit = found(world.closest(start, way, 0.0, f32::INFINITY, &|_, _, _| true));
        }
    };
    let mut engines: Vec<Engine<Found>> = Vec::new();
    if let Some(embree) = embree {
        let trace = |rays: &Rays, hits: &mut [Found]| embree.closest(rays, hits);
        engines.push(("rtcIntersect1".into(), Box::new(trace)));
    }
    engines.push(("own single".into(), Box::new(trace)));
    if share_origin {
        let trace = |rays: &Rays, hits: &mut [Found]| nearest_packets(world, rays, hits);
        engines.push(("own packets".into(), Box::new(trace)));
    }
    let results = race(rays, Found(0.0), &engines, rounds);
    println!("  {what}: {} rays", rays.len());
    for (i, ((name, _), (speed, hits))) in engines.iter().zip(&results).enumerate() {
        print!("    {name:14} {speed:7.2} Mrays/s");
        if let (true, Some((other, theirs))) = (i > 0 && embree.is_some(), results.first()) {
            let differ = hits.iter().zip(theirs).filter(|(a, b)| a.differs(**b)).count();
            let share = differ as f64 / rays.len() as f64;
            print!("   {:5.2} x rtcIntersect1, {share:.1e} differ from it", speed / other);
        }
        println!();
    }
}
