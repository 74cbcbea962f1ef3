//! The tensor pipeline against the brute-force sum, and what must not change its bits.

use super::scenes::{
    Frame, Shot, gathered, lamp, lights, look, maps, materials, relative_l2, room, same, soups,
    turning_room,
};
use glam::{DVec3, Vec3};
use lightloom_nodes as nodes;
use nodes::data::{Array, Field, Image, LightKind, Lights, Representatives, encode, write_arrays};
use nodes::kernel::history::cut;
use nodes::node::{All, Ctx, Derived, Error, Item, Node};
use nodes::{Choose, Fit, Scale};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

const SIZE: [u32; 2] = [16, 12];

/// The default choice of representatives with another count.
fn with_count(count: u32) -> nodes::Representatives {
    nodes::Representatives { count, ..Default::default() }
}

/// A shot of `count` frames under `many` gather lights.
fn shot(count: u32, size: [u32; 2], many: u32, bins: [u32; 2]) -> Shot {
    let frames = turning_room(count, size);
    let lights = gathered(&frames, many);
    Shot::new(frames, lights, bins)
}

#[test]
fn every_pair_its_own_cluster_is_the_brute_force_sum() {
    for frames in [1, 3] {
        // A row at every pixel, so that no light is missed.
        let shot = shot(frames, SIZE, 250, SIZE);
        let error = relative_l2(&shot.render(20, 250), &shot.reference());
        assert!(error < 1e-6, "{frames} frames: {error:e}");
    }
}

/// The bytes of what `run` gives on one thread and on two.
fn on_threads(what: &str, run: impl Fn() -> Vec<u8> + Sync + Send) -> Vec<u8> {
    let bytes = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(&run)
    };
    let (one, two) = (bytes(1), bytes(2));
    assert!(one == two, "{what} differs between one thread and two");
    one
}

#[test]
fn one_thread_and_two_give_the_same_bits() {
    let size = [48, 27];
    let frames = turning_room(3, size);
    let fresh = || turning_room(3, size);
    on_threads("DeepFramebuffer", || {
        fresh().iter().flat_map(|f| encode(&*f.framebuffer)).collect()
    });
    let lamp = lights(&[lamp(LightKind::Omni, Vec3::new(0.3, 0.8, 0.4), Vec3::Y, Vec3::ONE)]);
    on_threads("Photons", || encode(&frames[0].photons(Some(&lamp), Some(&lamp), 2000)));
    on_threads("PhotonLights", || encode(&frames[0].photon_lights(&lamp, 2000)));
    let samples: Item<_> = frames[0].gather_samples(600).unwrap().into();
    on_threads("GatherLights", || {
        let photons = frames[0].photons(Some(&lamp), None, 2000);
        encode(&frames[0].gather_lights(&samples, Some(&lamp), Some(photons), 20))
    });
    let lights = gathered(&frames, 600);
    on_threads("Rows", || encode(&frames[1].rows(&lights[1], [6, 4]).unwrap()));
    on_threads("Reference", || encode(&frames[1].reference(&lights[1])));
    on_threads("PixelMaps", || encode(&maps(&frames[0], &frames[1])));
    let shot = Shot::new(frames, lights, [6, 4]);
    let maps = shot.maps();
    on_threads("Clusters", || encode(&shot.clusters(20, 60, &maps)));
    on_threads("ColumnClusters", || encode(&shot.column_clusters(60)));
    let clusters: Item<_> = shot.clusters(20, 60, &maps).into();
    for choose in [Choose::Max, Choose::Random, Choose::Medoid] {
        let node = nodes::Representatives { choose, ..with_count(60) };
        on_threads("Representatives", || encode(&shot.representatives(&clusters, &node)));
    }
    let fitted = nodes::Representatives { fit: Fit::Rows, ..with_count(60) };
    on_threads("Representatives", || encode(&shot.representatives(&clusters, &fitted)));
    let representatives = shot.representatives(&clusters, &with_count(60));
    on_threads("Reconstruct", || {
        shot.reconstruct(representatives.clone(), &maps).iter().flat_map(encode).collect()
    });
    let image: Item<_> = shot.reconstruct(representatives.clone(), &maps).swap_remove(1).into();
    on_threads("AntiAlias", || encode(&smooth(&shot.frames[1], &image)));
}

fn smooth(frame: &Frame, image: &Item<Image>) -> Image {
    let input = nodes::AntiAliasIn {
        image: image.clone(),
        framebuffer: frame.framebuffer.clone(),
        geometry: frame.geometry.clone(),
        materials: frame.materials.clone(),
        poses: frame.poses.clone(),
        camera: frame.camera.clone(),
        environment: None,
    };
    nodes::AntiAlias::default().run(input, &Ctx::default()).expect("an image")
}

fn compare(images: &[Image], references: &[Image]) -> nodes::data::Comparison {
    let all = |i: &[Image]| All::from(i.iter().cloned().map(Item::from).collect::<Vec<_>>());
    let input = nodes::CompareIn { image: all(images), reference: all(references) };
    nodes::Compare::default().run(input, &Ctx::default()).expect("a comparison")
}

#[test]
fn more_columns_err_less_and_clusters_over_time_flicker_less() {
    let shot = shot(6, [32, 18], 1200, [8, 5]);
    let (maps, references) = (shot.maps(), shot.reference());
    let clusters: Item<_> = shot.clusters(20, 400, &maps).into();
    let with = |count| {
        let images = shot.reconstruct(shot.representatives(&clusters, &with_count(count)), &maps);
        relative_l2(&images, &references)
    };
    let errors = [25, 100, 400].map(with);
    assert!(errors[1] < 0.7 * errors[0] && errors[2] < 0.7 * errors[1], "{errors:?}");
    assert!(errors[2] < 0.05, "{errors:?}");
    let flicker = |clusters: Item<nodes::data::Clusters>| {
        let images = shot.reconstruct(shot.representatives(&clusters, &with_count(50)), &maps);
        compare(&images, &references).flicker
    };
    let (over_time, by_itself) =
        (flicker(clusters.clone()), flicker(shot.column_clusters(50).into()));
    assert!(over_time < 0.7 * by_itself, "{over_time} against {by_itself}");
}

#[test]
fn drawn_representatives_are_right_on_average() {
    const SEEDS: u64 = 256;
    let shot = shot(1, SIZE, 250, SIZE);
    let reference = shot.reference();
    let clusters: Item<_> = shot.clusters(1, 20, &[]).into();
    let mut mean = vec![DVec3::ZERO; reference[0].radiance.len()];
    let mut squares = 0.0;
    for seed in 0..SEEDS {
        let node = nodes::Representatives {
            count: 20,
            choose: Choose::Random,
            scale: Scale::Scalar,
            seed,
            ..Default::default()
        };
        let images = shot.reconstruct(shot.representatives(&clusters, &node), &[]);
        squares += relative_l2(&images, &reference).powi(2);
        mean.iter_mut()
            .zip(&*images[0].radiance)
            .for_each(|(m, p)| *m += p.as_dvec3() / SEEDS as f64);
    }
    let (width, height) = reference[0].size();
    let mean = Image::new(width, height, mean.iter().map(|m| m.as_vec3()).collect());
    let (off, single) = (relative_l2(&[mean], &reference), (squares / SEEDS as f64).sqrt());
    // The mean of 256 independent estimates errs by a sixteenth of one; a bias would stay.
    assert!(single > 0.02 && off < single / 11.0, "one errs by {single}, the mean by {off}");
}

#[test]
fn weights_fitted_to_the_rows_err_less() {
    let shot = shot(1, [64, 36], 1200, [16, 9]);
    let reference = shot.reference();
    let clusters: Item<_> = shot.column_clusters(40).into();
    // Between the rows, too: they are a sixteenth of the pixels.
    let error = |fit, seed| {
        let node = nodes::Representatives {
            count: 40,
            choose: Choose::Random,
            fit,
            seed,
            ..Default::default()
        };
        relative_l2(&shot.reconstruct(shot.representatives(&clusters, &node), &[]), &reference)
    };
    let mean = |fit| (0..8).map(|seed| error(fit, seed)).sum::<f64>() / 8.0;
    let (fitted, each) = (mean(Fit::Rows), mean(Fit::Cluster));
    assert!(fitted < 0.8 * each, "{fitted} against {each}");
}

#[test]
fn the_order_of_lights_does_not_count() {
    let shot = shot(1, SIZE, 250, [4, 3]);
    let lights = &shot.lights[0];
    let order: Vec<usize> =
        (0..lights.kind.len()).map(|j| (j * 77 + 13) % lights.kind.len()).collect();
    let mut sorted = order.clone();
    sorted.sort_unstable();
    assert!(sorted.iter().enumerate().all(|(i, j)| i == *j), "a permutation");
    let permuted = Lights {
        kind: order.iter().map(|&j| lights.kind[j]).collect(),
        position: order.iter().map(|&j| lights.position[j]).collect(),
        direction: order.iter().map(|&j| lights.direction[j]).collect(),
        emission: order.iter().map(|&j| lights.emission[j]).collect(),
        cone: order.iter().map(|&j| lights.cone[j]).collect(),
        clamp: order.iter().map(|&j| lights.clamp[j]).collect(),
        identity: 1,
    }
    .into();
    let (image, reference) =
        (shot.frames[0].reference(&permuted), shot.frames[0].reference(lights));
    assert!(relative_l2(&[image], &[reference]) < 1e-6);
    // Approximated, it is another draw of the same quality.
    let other = Shot::new(shot.frames.clone(), vec![permuted], [4, 3]);
    let reference = shot.reference();
    let errors = [&shot, &other].map(|s| relative_l2(&s.render(10, 60), &reference));
    assert!(errors[0] < 2.0 * errors[1] && errors[1] < 2.0 * errors[0], "{errors:?}");
}

/// The state of a reconstruction on disk, as an interrupted run leaves it before frame `next`.
fn state(next: u32, images: &[Image]) -> Vec<u8> {
    let pixels = images[0].radiance.len();
    let flat: Vec<Vec3> = images.iter().flat_map(|i| i.radiance.to_vec()).collect();
    let flat = Array::shaped(flat, &[images.len(), pixels]);
    let check: Array<u8> = blake3::hash(flat.view().bytes).as_bytes().to_vec().into();
    let mut bytes = Vec::new();
    write_arrays(
        &mut bytes,
        &[("next", next.view()), ("images", flat.view()), ("check", check.view())],
    )
    .unwrap();
    bytes
}

#[test]
fn an_interrupted_reconstruction_goes_on_to_the_same_bits() {
    let shot = shot(3, SIZE, 250, [4, 3]);
    let maps = shot.maps();
    let clusters: Item<_> = shot.clusters(10, 40, &maps).into();
    let all = shot.representatives(&clusters, &with_count(40));
    let whole = shot.reconstruct(all.clone(), &maps);

    // What stands on disk before frame 2: the sum of the representatives of frames 0 and 1.
    let n = all.pair.iter().filter(|p| p[1] < 2).count();
    assert!(n > 0 && n < all.pair.len(), "both parts have representatives");
    let half = Representatives {
        pair: all.pair[..n].to_vec().into(),
        frames: all.frames[..n].to_vec().into(),
        first_weight: all.first_weight[..n].to_vec().into(),
        ..all.clone()
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("state");
    std::fs::write(&path, state(2, &shot.reconstruct(half, &maps))).unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let ctx = |progress: Box<dyn Fn(u64, u64) + Send + Sync>| {
        Ctx::new(Arc::clone(&stop), Arc::new(Derived::new(1 << 30)), progress, Some(path.clone()))
    };

    // Stopped at the first sign of progress, it leaves the state as it was.
    let raised = Arc::clone(&stop);
    let stopping = ctx(Box::new(move |_, _| raised.store(true, Ordering::Relaxed)));
    let stopped = nodes::Reconstruct {}.run(shot.to_reconstruct(all.clone(), &maps), &stopping);
    assert!(matches!(stopped, Err(Error::Cancelled)));
    stop.store(false, Ordering::Relaxed);

    let resumed = ctx(Box::new(|_, _| {}));
    let images =
        nodes::Reconstruct {}.run(shot.to_reconstruct(all, &maps), &resumed).unwrap().items;
    assert_eq!(resumed.notes(), ["went on from a checkpoint at step 2"]);
    assert!(images.iter().zip(&whole).all(|(a, b)| same(a, b)));
}

#[test]
fn a_static_shot_maps_to_itself() {
    let frame = turning_room(1, SIZE).remove(0);
    let lights = gathered(std::slice::from_ref(&frame), 250).remove(0);
    let shot = Shot::new(vec![frame.clone(); 3], vec![lights; 3], [4, 3]);
    let pixels = (SIZE[0] * SIZE[1]) as usize;
    let identity: Vec<u32> = (0..pixels as u32).collect();
    // Equal frames, and frames that differ in nothing that is compared.
    let mut other = (*frame.framebuffer).clone();
    other.emitted = Array::shaped(vec![Vec3::ONE; pixels], frame.framebuffer.emitted.shape());
    let other = Frame { framebuffer: other.into(), ..frame.clone() };
    for next in [&frame, &other] {
        let maps = maps(&frame, next);
        assert!(maps.forward[..] == identity && maps.backward[..] == identity);
        assert_eq!(maps.far, 0.0);
    }
    let images = shot.render(10, 40);
    assert!(images.iter().all(|i| same(i, &images[0])));
    let error = relative_l2(&images, &shot.reference());
    assert!(error < 0.15, "{error}");
}

#[test]
fn no_cluster_reaches_across_a_camera_cut() {
    let surfaces = materials(&[Vec3::splat(0.7), Vec3::X, Vec3::Y].map(|a| (a * 0.5, Vec3::ZERO)));
    let (geometry, materials) = (soups(&[room()]).into(), surfaces.into());
    let to = |at: Vec3, step: f32| {
        let camera = look(Vec3::new(0.5 + 0.01 * step, 0.5, 0.5), at, 0.4);
        Frame::posed(&geometry, &materials, &[glam::Mat4::IDENTITY], camera, SIZE)
    };
    let (left, right) = (Vec3::new(0.0, 0.5, 0.5), Vec3::new(1.0, 0.5, 0.5));
    let frames = vec![to(left, 0.0), to(left, 1.0), to(right, 2.0), to(right, 3.0)];
    let lights = gathered(&frames, 250);
    let shot = Shot::new(frames, lights, [4, 3]);
    let maps = shot.maps();
    let far: Vec<f32> = maps.iter().map(|m| m.far).collect();
    assert!(far[0] < 0.1 && far[1] > 0.9 && far[2] < 0.1, "{far:?}");
    let across = |maps: &[Item<nodes::data::PixelMaps>]| {
        let input = nodes::ClustersIn { rows: shot.all_rows(), maps: Some(maps.to_vec().into()) };
        let node = nodes::Clusters { start: 10, limit: 30, ..Default::default() };
        let ctx = Ctx::default();
        let clusters = node.run(input, &ctx).unwrap();
        let spans = |c: &nodes::kernel::clustering::Cluster| c.first_frame < 2 && c.last_frame > 2;
        let count = [1, 60, 120]
            .map(|count| cut(&clusters, count).unwrap().iter().filter(|c| spans(c)).count());
        (count, ctx.notes())
    };
    assert_eq!(
        across(&maps),
        ([0; 3], vec!["the camera cuts at 1 places of the chunk".to_owned()])
    );
    assert!(across(&[]).0[0] > 0, "without maps, nothing tells of the cut");
    // Nothing is carried over: each side is as good as by itself.
    let error = relative_l2(&shot.render(10, 100), &shot.reference());
    assert!(error < 0.1, "{error}");
}
