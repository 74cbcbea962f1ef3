//! Speed of quantized point-based global illumination on the pavilion, each kernel beside what would do the same without it:
//! `cargo bench -p lightloom-nodes --bench pbgi`. Throughputs of a group are comparable; their ratio is the gain. With `-- seconds`,
//! one run each of what takes seconds, in CPU time beside its target; with `-- gather`, the last of them alone, what pixels gather.

use cpu_time::ProcessTime;
use divan::Bencher;
use divan::counter::ItemsCount;
use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use lightloom_nodes::data::{self, Array, RadiantSurfels};
use lightloom_nodes::kernel::element::Receiver;
use lightloom_nodes::kernel::pbgi::gather::{
    Gather, MicroBuffer, Scratch, Settings, Shape as Cells, Work,
};
use lightloom_nodes::kernel::pbgi::lut::{KMeans, Lut as Table, Quantizer, Seeding};
use lightloom_nodes::kernel::pbgi::poisson_disk;
use lightloom_nodes::kernel::pbgi::stored::{Recipe, Shape, as_binary, build, scales};
use lightloom_nodes::kernel::pbgi::stream::Average;
use lightloom_nodes::kernel::pbgi::tree::looks::Format;
use lightloom_nodes::kernel::primary;
use lightloom_nodes::kernel::receivers::Receivers;
use lightloom_nodes::kernel::stage::Stage;
use lightloom_nodes::kernel::surface_sampling;
use lightloom_nodes::node::{Ctx, Error, Item, Many, Node};
use lightloom_nodes::*;
use std::sync::{Arc, LazyLock};

/// Numbers of a vector of three bands: 27 of colour and 9 of area.
const DIMS: usize = 36;
const RECIPE: Recipe =
    Recipe { shape: Shape::Binary, average: Average::Area, format: Format::A, bands: 3 };
/// Sizes of tables.
const ENTRIES: [u32; 3] = [100, 1000, 10_000];
/// Vectors that tables are trained on.
const TRAINED: usize = 500_000;
/// Of the picture whose pixels gather.
const SIZE: [u32; 2] = [480, 270];
/// Receivers of a tile, and of how many tiles one gathers.
const TILE: usize = 64;
const TILES: usize = 64;
/// Surfels of the tree; some of them are buried.
const SURFELS: u32 = 620_000;

fn main() {
    // One thread for all, so that a pair compares kernels and not numbers of threads.
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("the first pool");
    let asked = |word: &str| std::env::args().any(|argument| argument == word);
    if asked("gather") {
        gathered().expect("trees of the pavilion");
    } else if asked("seconds") {
        LazyLock::force(&SHOT);
        sampled();
        quantized();
        trained();
        gathered().expect("trees of the pavilion");
    } else {
        divan::main();
    }
}

/// The pavilion, its surfels, the vectors of their tree and tables of those.
struct Shot {
    stage: Arc<Stage>,
    surfels: RadiantSurfels,
    vectors: Vec<f32>,
    tables: Vec<data::Lut>,
    environment: Item<data::Environment>,
    receivers: Vec<Receiver>,
}

static SHOT: LazyLock<Shot> = LazyLock::new(|| shot().expect("the pavilion is lit"));

fn shot() -> Result<Shot, Error> {
    let ctx = Ctx::default();
    let scene = Item::from(Pavilion::default().run((), &ctx)?);
    let geometry = Item::from(Geometry::default().run(GeometryIn { scene: scene.clone() }, &ctx)?);
    let materials = Item::from(Materials {}.run(MaterialsIn { scene: scene.clone() }, &ctx)?);
    let camera = Camera::default().run(CameraIn { scene: scene.clone(), time: None }, &ctx)?;
    let poses = Item::from(Poses {}.run(PosesIn { scene, time: None }, &ctx)?);
    let environment = Item::from(Sky::default().run((), &ctx)?);
    let sky = EnvironmentLights { count: 15, ..EnvironmentLights::default() };
    let sky = sky.run(EnvironmentLightsIn { environment: environment.clone() }, &ctx)?;
    let input = DeepFramebufferIn {
        geometry: geometry.clone(),
        materials: materials.clone(),
        poses: poses.clone(),
        camera: camera.into(),
        environment: Some(environment.clone()),
    };
    let camera_sees = DeepFramebuffer { size: SIZE, ..DeepFramebuffer::default() };
    let receivers = Receivers::of(&camera_sees.run(input, &ctx)?).samples;
    let sun = SunLights { count: 1, ..SunLights::default() }.run((), &ctx)?;
    let lights = MergeLightsIn { lights: Many(vec![sun.into(), sky.into()]) };
    let input =
        SurfelsIn { geometry: geometry.clone(), materials: materials.clone(), rest: poses.clone() };
    let stage = Stage::of(&ctx, &geometry, &materials, &poses)?;
    let surfels = Surfels { count: SURFELS, ..Surfels::default() }.run(input, &ctx)?;
    let input = ShadeSurfelsIn {
        surfels: surfels.into(),
        geometry,
        materials,
        poses,
        lights: Some(MergeLights::default().run(lights, &ctx)?.into()),
        tree: None,
    };
    let surfels = ShadeSurfels::default().run(input, &ctx)?;
    let vectors = build(&surfels, RECIPE, None)?.0.rows.to_vec();
    let tables = ENTRIES.iter().map(|&entries| {
        let settings = KMeans { entries, iterations: 2, ..KMeans::default() };
        let table = Table::build(
            &vectors[..vectors.len().min(TRAINED * DIMS)],
            DIMS,
            &settings,
            &|_, _| Ok(()),
        )?;
        let rows = table.entries.len() / DIMS;
        Ok(data::Lut {
            entries: Array::shaped(table.entries, &[rows, DIMS]),
            bands: 3,
            balance: 1.0,
        })
    });
    let tables = tables.collect::<Result<_, Error>>()?;
    Ok(Shot { stage, surfels, vectors, tables, environment, receivers })
}

/// The table of so many entries.
fn table(entries: u32) -> &'static data::Lut {
    let at = ENTRIES.iter().position(|&e| e == entries).expect("a size of ENTRIES");
    &SHOT.tables[at]
}

/// Runs of 100 vectors in the order of the tree, from all over it.
fn asked() -> Vec<&'static [f32]> {
    let runs = SHOT.vectors.chunks_exact(100 * DIMS);
    let step = (runs.len() / 50).max(1);
    runs.step_by(step).flat_map(|run| run.chunks_exact(DIMS)).collect()
}

fn square(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum()
}

/// The nearest by comparing with all, and how near.
fn plain(vector: &[f32], entries: &[f32]) -> (usize, f32) {
    let squares = entries.chunks_exact(DIMS).map(|entry| square(vector, entry)).enumerate();
    squares.fold((0, f32::INFINITY), |best, next| if next.1 < best.1 { next } else { best })
}

fn kd_tree(entries: &[f32]) -> ImmutableKdTree<f32, DIMS> {
    let points: Vec<[f32; DIMS]> = entries.as_chunks().0.to_vec();
    ImmutableKdTree::new_from_slice(&points).expect("finite points")
}

#[divan::bench(args = ENTRIES)]
fn nearest_by_boxes(bencher: Bencher, entries: u32) {
    let (table, asked) = (table(entries), asked());
    let own = Quantizer::new(&table.entries, DIMS).expect("a table");
    // All three give the same answers, to rounding.
    let tree = kd_tree(&table.entries);
    for vector in asked.iter().step_by(7) {
        let [query] = vector.as_chunks().0 else { panic!("a vector of {DIMS} numbers") };
        let found = own.nearest(vector, 0) as usize * DIMS;
        let square = square(vector, &table.entries[found..found + DIMS]);
        let best = plain(vector, &table.entries).1;
        let other = tree.query(query).nearest_one::<SquaredEuclidean<f32>>().execute().distance;
        assert!(square <= best * 1.00001 && (best - other).abs() <= best * 1e-5 + 1e-30);
    }
    bencher
        .counter(ItemsCount::new(asked.len()))
        .bench(|| asked.iter().fold(0, |hint, vector| own.nearest(vector, hint)));
}

#[divan::bench(args = ENTRIES, sample_count = 5)]
fn nearest_by_kiddo(bencher: Bencher, entries: u32) {
    let (tree, asked) = (kd_tree(&table(entries).entries), asked());
    bencher.counter(ItemsCount::new(asked.len())).bench(|| {
        let queries = asked.iter().flat_map(|vector| vector.as_chunks().0);
        let nearest = |q: &[f32; DIMS]| {
            tree.query(q).nearest_one::<SquaredEuclidean<f32>>().execute().distance
        };
        queries.map(nearest).sum::<f32>()
    });
}

#[divan::bench(args = ENTRIES, sample_count = 1)]
fn nearest_by_comparing(bencher: Bencher, entries: u32) {
    let (table, asked) = (table(entries), asked());
    bencher
        .counter(ItemsCount::new(asked.len()))
        .bench(|| asked.iter().map(|vector| plain(vector, &table.entries).0).sum::<usize>());
}

#[divan::bench(args = [0, 100, 1000, 10_000], sample_count = 3)]
fn tree_with_a_table_of(bencher: Bencher, entries: u32) {
    let table = (entries > 0).then(|| table(entries));
    let nodes = SHOT.vectors.len() / DIMS;
    bencher
        .counter(ItemsCount::new(nodes))
        .bench(|| build(&SHOT.surfels, RECIPE, table).map(|built| built.1.live));
}

/// Samples of the sampling benches.
const SAMPLES: u32 = 100_000;

fn corners(triangle: u32) -> [Vec3; 3] {
    match SHOT.stage.area(triangle) > 0.0 {
        true => SHOT.stage.triangle(triangle),
        false => [Vec3::ZERO; 3],
    }
}

#[divan::bench(sample_count = 5)]
fn surfels_by_poisson_disk(bencher: Bencher) {
    let triangles = SHOT.stage.triangles();
    bencher
        .counter(ItemsCount::new(SAMPLES))
        .bench(|| poisson_disk::sample(corners, triangles, SAMPLES, 1).radius);
}

#[divan::bench(sample_count = 5)]
fn surfels_by_area(bencher: Bencher) {
    let triangles = SHOT.stage.triangles();
    bencher.counter(ItemsCount::new(SAMPLES)).bench(|| {
        let areas: Vec<f64> = (0..triangles).map(|t| f64::from(SHOT.stage.area(t))).collect();
        surface_sampling::sample(&areas, SAMPLES, 1).len()
    });
}

/// The result of some work and its seconds of CPU time.
fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = ProcessTime::now();
    let result = work();
    (result, start.elapsed().as_secs_f64())
}

/// k-means of the size of the paper.
fn trained() {
    let vectors = &SHOT.vectors[..SHOT.vectors.len().min(TRAINED * DIMS)];
    for (name, seeding) in [("random", Seeding::Random), ("plus_plus", Seeding::PlusPlus)] {
        let settings = KMeans { entries: 10_000, iterations: 15, seeding, ..KMeans::default() };
        let run = || Table::build(vectors, DIMS, &settings, &|_, _| Ok(()));
        let (table, seconds) = timed(run);
        let inertia = table.expect("finite vectors").inertia;
        println!(
            "k-means, {} vectors, 10000 entries, {} rounds by {name}: {seconds:.1} s, {:.0} % of 15 s; inertia {:.5}",
            vectors.len() / DIMS,
            inertia.len(),
            seconds / 0.15,
            inertia[inertia.len() - 1],
        );
    }
}

/// What quantization adds to the making of a tree: the least of three runs, in turns.
fn quantized() {
    let nodes = (SHOT.vectors.len() / DIMS) as f64;
    let tables = [None, Some(table(100)), Some(table(1000)), Some(table(10_000))];
    let mut least = [f64::INFINITY; 4];
    for _ in 0..3 {
        for (least, table) in least.iter_mut().zip(tables) {
            let (built, seconds) = timed(|| build(&SHOT.surfels, RECIPE, table));
            built.expect("surfels");
            *least = least.min(seconds);
        }
    }
    for (entries, seconds) in ENTRIES.iter().zip(&least[1..]) {
        println!(
            "tree of {nodes} nodes, {entries} entries: {:.2} of the time of plain vectors (paper 3.9), {:.0} ns a node more (at most 1000)",
            seconds / least[0],
            (seconds - least[0]) * 1e9 / nodes,
        );
    }
}

/// What pixels gather, together and each by a walk of its own: the median ratio of five rounds in turns, the least times.
fn gathered() -> Result<(), Error> {
    let tiles = SHOT.receivers.chunks(TILE).step_by(TILES);
    let receivers: Vec<Receiver> = tiles.flatten().copied().collect();
    let buffer = MicroBuffer::new(Cells::Cube, 8);
    let settings = Settings { factor: 2.0, ..Settings::default() };
    let background = |direction: Vec3| primary::background(&SHOT.environment, direction);
    let compact = Recipe { format: Format::B, ..RECIPE };
    for (name, recipe, lut) in [
        ("vectors of their own", RECIPE, None),
        ("10,000 entries, leaves B", compact, Some(table(10_000))),
    ] {
        let (tree, _) = build(&SHOT.surfels, recipe, lut)?;
        let scales = scales(&tree)?;
        let hierarchy = as_binary(&tree, &scales);
        let gather = Gather { hierarchy: &hierarchy, buffer: &buffer, settings, background };
        let (mut ratios, mut least) = (Vec::new(), [f64::INFINITY; 2]);
        for _ in 0..5 {
            let (together, fast) = timed(|| gather.all(&receivers, |_, _| Ok::<_, Error>(())));
            let (alone, slow) = timed(|| {
                let (mut scratch, mut work) = (Scratch::default(), Work::default());
                let one = |receiver| gather.one(receiver, &mut scratch, &mut work);
                receivers.iter().map(one).collect::<Vec<_>>()
            });
            assert_eq!(together?.0, alone);
            ratios.push(slow / fast);
            least = [least[0].min(fast), least[1].min(slow)];
        }
        ratios.sort_by(f64::total_cmp);
        let [fast, slow] = least.map(|seconds| seconds * 1e6 / receivers.len() as f64);
        println!(
            "gather of {} pixels from nodes with {name}: {fast:.0} us a receiver, alone {slow:.0} us; {:.2} times as fast",
            receivers.len(),
            ratios[ratios.len() / 2],
        );
    }
    Ok(())
}

/// Poisson-disk samples of the size of large scenes.
fn sampled() {
    let run = || poisson_disk::sample(corners, SHOT.stage.triangles(), 1_000_000, 1);
    let (samples, seconds) = timed(run);
    println!("{} surfels: {seconds:.1} s of CPU time", samples.triangle.len());
}
