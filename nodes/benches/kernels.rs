//! Speed of the kernels on the pavilion, each beside what would do the same without it:
//! `cargo bench -p lightloom-nodes`. Throughputs of a pair are comparable; their ratio is the gain.

use divan::Bencher;
use divan::counter::ItemsCount;
use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use lightloom_nodes::data::{self, LightKind};
use lightloom_nodes::kernel::light_tensor::{LightTensor, RayTensor};
use lightloom_nodes::kernel::neighbours::{Features, Pyramid, compose, map};
use lightloom_nodes::kernel::nine_vectors::nine_vectors;
use lightloom_nodes::kernel::receivers::Receivers;
use lightloom_nodes::kernel::scaled_sums::Waiting;
use lightloom_nodes::kernel::stage::Stage;
use lightloom_nodes::kernel::visibility::{Blocker, Ends};
use lightloom_nodes::node::{Ctx, Error, Item, Node};
use lightloom_nodes::*;
use std::sync::{Arc, LazyLock};

fn main() {
    // One thread for all, so that a pair compares kernels and not numbers of threads.
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("the first pool");
    divan::main();
}

/// Two frames of the pavilion a second apart, and lights on its surfaces and in its sky.
struct Shot {
    stage: Arc<Stage>,
    lights: data::Lights,
    receivers: Receivers,
    features: [Arc<Features>; 2],
}

static SHOT: LazyLock<Shot> = LazyLock::new(|| shot().expect("the pavilion renders"));

fn shot() -> Result<Shot, Error> {
    let ctx = Ctx::default();
    let scene = Item::from(Pavilion::default().run((), &ctx)?);
    let geometry = Item::from(Geometry::default().run(GeometryIn { scene: scene.clone() }, &ctx)?);
    let materials = Item::from(Materials {}.run(MaterialsIn { scene: scene.clone() }, &ctx)?);
    let mut frames = Vec::new();
    for seconds in [0.0, 0.05] {
        let time = Some(Item::from(data::Time { seconds }));
        let poses = Poses {}.run(PosesIn { scene: scene.clone(), time: time.clone() }, &ctx)?;
        let camera = Camera::default().run(CameraIn { scene: scene.clone(), time }, &ctx)?;
        let poses = Item::from(poses);
        let input = DeepFramebufferIn {
            geometry: geometry.clone(),
            materials: materials.clone(),
            poses: poses.clone(),
            camera: camera.into(),
            environment: None,
        };
        let seen = DeepFramebuffer { size: [320, 180], ..DeepFramebuffer::default() };
        frames.push((poses, Item::from(seen.run(input, &ctx)?)));
    }
    let (poses, framebuffer) = &frames[0];
    let stage = Stage::of(&ctx, &geometry, &materials, poses)?;
    let input = GatherSamplesIn {
        geometry: geometry.clone(),
        materials: materials.clone(),
        rest: poses.clone(),
    };
    let samples = GatherSamples { count: 4096, ..GatherSamples::default() }.run(input, &ctx)?;
    let weights = [1.0, 0.125, 0.125];
    let features = [
        nine_vectors(&ctx, framebuffer, &geometry, weights)?,
        nine_vectors(&ctx, &frames[1].1, &geometry, weights)?,
    ];
    let lights = surface_lights(&stage, &samples);
    Ok(Shot { lights, receivers: Receivers::of(framebuffer), stage, features })
}

/// A white cosine light on every gather sample.
fn surface_lights(stage: &Stage, samples: &data::GatherSamples) -> data::Lights {
    let surfaces: Vec<_> = samples
        .triangle
        .iter()
        .zip(samples.barycentric.iter())
        .map(|(t, at)| stage.surface(*t, at.x, at.y))
        .collect();
    let n = surfaces.len();
    data::Lights {
        kind: vec![LightKind::Cosine as u8; n].into(),
        position: surfaces.iter().map(|s| s.position).collect(),
        direction: surfaces.iter().map(|s| s.facet).collect(),
        emission: vec![Vec3::ONE; n].into(),
        cone: vec![glam::Vec2::ZERO; n].into(),
        clamp: vec![0.1; n].into(),
        identity: 1,
    }
}

/// Every 512th light.
const STEP: usize = 512;

#[divan::bench]
fn columns_by_packets(bencher: Bencher) {
    let tensor = RayTensor::new(&SHOT.stage, &SHOT.lights);
    let samples = &SHOT.receivers.samples;
    let elements = samples.len() * tensor.lights() / STEP;
    bencher.counter(ItemsCount::new(elements)).bench(|| {
        let mut column = [Vec3::ZERO; Ends::CAPACITY];
        let mut sum = Vec3::ZERO;
        for j in (0..tensor.lights()).step_by(STEP) {
            let mut blocker = Blocker::default();
            for packet in samples.chunks(Ends::CAPACITY) {
                let (tile, column) = (tensor.tile(packet), &mut column[..packet.len()]);
                tensor.column(j, &tile, &mut blocker, column);
                sum += column[0];
            }
        }
        sum
    });
}

#[divan::bench]
fn columns_ray_by_ray(bencher: Bencher) {
    let tensor = RayTensor::new(&SHOT.stage, &SHOT.lights);
    let samples = &SHOT.receivers.samples;
    let elements = samples.len() * tensor.lights() / STEP;
    bencher.counter(ItemsCount::new(elements)).bench(|| {
        let lights = (0..tensor.lights()).step_by(STEP);
        lights.map(|j| samples.iter().map(|s| tensor.element(s, j)).sum::<Vec3>()).sum::<Vec3>()
    });
}

#[divan::bench]
fn rows_by_packets(bencher: Bencher) {
    let tensor = RayTensor::new(&SHOT.stage, &SHOT.lights);
    let samples: Vec<_> = SHOT.receivers.samples.iter().step_by(4096).collect();
    let mut row = vec![Vec3::ZERO; tensor.lights()];
    let elements = samples.len() * tensor.lights();
    bencher.counter(ItemsCount::new(elements)).bench_local(|| {
        samples.iter().for_each(|s| tensor.row(s, &mut row));
        row[0]
    });
}

#[divan::bench]
fn pixel_map_by_pyramid(bencher: Bencher) {
    let [source, target] = &SHOT.features;
    let pixels = target.width() as usize * target.height() as usize;
    bencher
        .counter(ItemsCount::new(pixels))
        .bench(|| map(&Pyramid::build(source), target, f32::INFINITY).pixel.len());
}

#[divan::bench]
fn pixel_map_by_kiddo(bencher: Bencher) {
    let vectors = |f: &Features| -> Vec<[f32; 9]> {
        (0..f.width() * f.height()).filter_map(|pixel| f.vector(pixel)).collect()
    };
    let [source, target] = SHOT.features.each_ref().map(|f| vectors(f));
    bencher.counter(ItemsCount::new(target.len())).bench(|| {
        let tree: ImmutableKdTree<f32, 9> =
            ImmutableKdTree::new_from_slice(&source).expect("finite points");
        let nearest =
            |q: &[f32; 9]| tree.query(q).nearest_one::<SquaredEuclidean<f32>>().execute().distance;
        target.iter().map(nearest).sum::<f32>()
    });
}

#[divan::bench]
fn map_composed(bencher: Bencher) {
    let [source, target] = &SHOT.features;
    let step = map(&Pyramid::build(source), target, f32::INFINITY).pixel;
    let still: Vec<u32> = (0..source.width() * source.height()).collect();
    bencher
        .counter(ItemsCount::new(step.len()))
        .bench(|| compose(&still, &step, source, target).map(|map| map.len()));
}

/// Columns of one frame, and frames that each of them serves.
const COLUMNS: usize = 200;
const SERVED: usize = 8;
/// Pixels whose sums for all frames served are held at once.
const BLOCK: usize = 8 * Ends::CAPACITY;

/// Columns, `[column][pixel]`, their weights in the frames, and the map from each frame into theirs.
struct Columns {
    columns: Vec<Vec<Vec3>>,
    weights: Vec<Vec<Vec3>>,
    map: Vec<u32>,
}

static COLUMNS_AND_MAP: LazyLock<Columns> = LazyLock::new(|| {
    let [source, target] = &SHOT.features;
    let map = map(&Pyramid::build(source), target, f32::INFINITY).pixel;
    let number = |i: usize| ((i * 2_654_435_761) % 1024) as f32 / 1024.0;
    let vectors = |n: usize, seed: usize| -> Vec<Vec3> {
        (0..n).map(|i| Vec3::new(number(i + seed), number(i * 3), number(i + 7))).collect()
    };
    Columns {
        columns: (0..COLUMNS).map(|c| vectors(map.len(), c)).collect(),
        weights: (0..COLUMNS).map(|c| vectors(SERVED, c)).collect(),
        map,
    }
});

fn items() -> ItemsCount {
    ItemsCount::new(COLUMNS * SERVED * COLUMNS_AND_MAP.map.len())
}

/// Nothing comes from where no surface was seen.
fn mapped(column: &[Vec3], pixel: u32) -> Vec3 {
    column.get(pixel as usize).copied().unwrap_or_default()
}

/// What `Reconstruct` does with rendered columns: sums of each tile in the frame of the columns, then one map a frame.
#[divan::bench]
fn columns_summed_then_mapped(bencher: Bencher) {
    let Columns { columns, weights, map } = &*COLUMNS_AND_MAP;
    bencher.counter(items()).bench(|| {
        let mut summed = vec![vec![Vec3::ZERO; map.len()]; SERVED];
        let mut waiting = Waiting::new();
        for first in (0..map.len()).step_by(BLOCK) {
            let pixels = BLOCK.min(map.len() - first);
            let mut sums = [vec![Vec3::ZERO; SERVED * pixels]];
            for at in (0..pixels).step_by(Ends::CAPACITY) {
                for (column, weights) in columns.iter().zip(weights) {
                    let tile = &column[first + at..first + pixels.min(at + Ends::CAPACITY)];
                    waiting.room()[..tile.len()].copy_from_slice(tile);
                    waiting.count_in(0, 0, weights);
                    if waiting.keep() {
                        waiting.add(&mut sums, pixels, at);
                    }
                }
                waiting.add(&mut sums, pixels, at);
            }
            for (all, sum) in summed.iter_mut().zip(sums[0].chunks_exact(pixels)) {
                all[first..first + pixels].copy_from_slice(sum);
            }
        }
        let image =
            |sum: &Vec<Vec3>| -> Vec<Vec3> { map.iter().map(|&p| mapped(sum, p)).collect() };
        summed.iter().map(image).collect::<Vec<_>>()
    });
}

/// The same, each column mapped into each frame by itself.
#[divan::bench(sample_count = 10)]
fn columns_mapped_one_by_one(bencher: Bencher) {
    let Columns { columns, weights, map } = &*COLUMNS_AND_MAP;
    bencher.counter(items()).bench(|| {
        let image = |frame: usize| {
            let mut image = vec![Vec3::ZERO; map.len()];
            for (column, weights) in columns.iter().zip(weights) {
                let weight = weights[frame];
                let add = |(sum, &p): (&mut Vec3, &u32)| *sum += weight * mapped(column, p);
                image.iter_mut().zip(map).for_each(add);
            }
            image
        };
        (0..SERVED).map(image).collect::<Vec<_>>()
    });
}
