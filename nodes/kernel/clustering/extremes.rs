//! Clustering at the extremes: what every node that clusters may rely on.

use proptest::prelude::*;

use super::fixtures::{no_tick, noise, smooth, sorted, tensor_of};
use super::{Cluster, Error, History, Mode, Settings, Tensor, cluster_columns, cluster_tensor};

fn settings(start: usize, limit: usize) -> Settings<'static> {
    Settings { start, limit, time_weight: 1.0, seed: 7, cuts: &[] }
}

fn cluster(tensor: &Tensor, start: usize, limit: usize) -> History {
    cluster_tensor(tensor, &settings(start, limit), &no_tick).unwrap()
}

fn lit(tensor: &Tensor, cluster: &Cluster) -> usize {
    let frames = cluster.first_frame as usize..cluster.last_frame as usize;
    let norms = cluster.lights.iter().flat_map(|&j| tensor.norms(j as usize, frames.clone()));
    norms.filter(|&&w| w > 0.0).count()
}

/// Fails unless every light-frame pair is in exactly one of the clusters and dark rectangles.
fn assert_partition(tensor: &Tensor, history: &History, count: usize) {
    let mut owners = vec![0; tensor.lights() * tensor.frames()];
    let clusters = history.cut(count).unwrap();
    for dark in history.dark().unwrap() {
        assert_eq!(lit(tensor, &dark), 0);
    }
    for Cluster { lights, first_frame, last_frame } in
        history.dark().unwrap().iter().chain(&clusters)
    {
        assert!(lights.is_sorted_by(|a, b| a < b) && first_frame < last_frame);
        for light in lights {
            for frame in *first_frame..*last_frame {
                owners[*light as usize * tensor.frames() + frame as usize] += 1;
            }
        }
    }
    assert!(owners.iter().all(|&owners| owners == 1), "{owners:?}");
}

/// The papers' cost of a set of clusters, summed over unordered pairs of columns.
fn double_sum(tensor: &Tensor, clusters: &[Cluster]) -> f64 {
    let mut total = 0.0;
    for cluster in clusters {
        let mut columns: Vec<(f64, &[f32])> = Vec::new();
        for &light in &cluster.lights {
            for frame in cluster.first_frame as usize..cluster.last_frame as usize {
                let w = tensor.norms(light as usize, frame..frame + 1)[0];
                if w > 0.0 {
                    columns.push((w, tensor.column(light as usize, frame)));
                }
            }
        }
        for (at, (w_p, p)) in columns.iter().enumerate() {
            for (w_q, q) in &columns[..at] {
                let apart =
                    |(&a, &b): (&f32, &f32)| (f64::from(a) / w_p - f64::from(b) / w_q).powi(2);
                total += w_p * w_q * p.iter().zip(*q).map(apart).sum::<f64>();
            }
        }
    }
    total
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn every_pair_is_in_exactly_one_rectangle(
        (lights, rows, frames) in (1usize..14, 1usize..6, 1usize..7),
        (start, extra) in (1usize..5, 0usize..60),
        (dark, same) in (0f32..1.0, prop::bool::ANY),
        (seed, cut) in (0u64..1000, prop::option::of(1usize..6)),
    ) {
        let tensor = tensor_of(lights, rows, frames, |j, i, k| {
            if noise(j, 40 + seed as usize, k) < dark { 0.0 } else if same { 1.0 + i as f32 } else { noise(j, i, k) }
        });
        let cuts: Vec<usize> = cut.into_iter().filter(|&cut| cut < frames).collect();
        let limit = start * (cuts.len() + 1) + extra;
        let settings = Settings { start, limit, time_weight: 1.0, seed, cuts: &cuts };
        let history = cluster_tensor(&tensor, &settings, &no_tick).unwrap();
        let pairs = (0..lights).flat_map(|j| tensor.norms(j, 0..frames)).filter(|&&w| w > 0.0).count();
        prop_assert!(history.max_count() <= limit.min(pairs));
        for count in history.min_count()..=history.max_count() {
            assert_partition(&tensor, &history, count);
            let clusters = history.cut(count).unwrap();
            prop_assert!(clusters.iter().all(|c| lit(&tensor, c) > 0));
            let spans = |c: &Cluster| cuts.iter().any(|&cut| (c.first_frame as usize) < cut && cut < c.last_frame as usize);
            prop_assert!(!clusters.iter().any(spans));
            if pairs > 0 {
                let (cost, expected) = (history.cost(count).unwrap(), double_sum(&tensor, &clusters));
                prop_assert!((cost - expected).abs() <= 1e-11 * (1.0 + expected), "{} {}", cost, expected);
            }
        }
        if limit >= pairs {
            prop_assert_eq!(history.max_count(), pairs);
        }
    }

    #[test]
    fn a_cut_history_is_a_shorter_run(limit in 5usize..90, seed in 0u64..1000) {
        let tensor = smooth(60, 9, 4);
        let long = Settings { seed, ..settings(5, 100) };
        let history = cluster_tensor(&tensor, &long, &no_tick).unwrap();
        let short = cluster_tensor(&tensor, &Settings { limit, ..long }, &no_tick).unwrap();
        prop_assert_eq!(history.cut(limit).unwrap(), short.cut(limit).unwrap());
        prop_assert_eq!(&history.costs[..short.costs.len()], &short.costs[..]);
        prop_assert_eq!(&history.splits[..short.splits.len()], &short.splits[..]);
    }
}

#[test]
fn with_enough_clusters_every_contributing_pair_is_alone() {
    let tensor = smooth(30, 9, 6);
    let history = cluster(&tensor, 4, 30 * 6);
    let clusters = history.cut(usize::MAX).unwrap();
    assert!(clusters.iter().all(|c| lit(&tensor, c) == 1));
    assert!(clusters.len() < 180, "some pairs are dark");
    assert_eq!(history.cost(180), Some(0.0));
}

#[test]
fn a_black_tensor_gives_no_cluster() {
    let tensor = tensor_of(6, 3, 4, |_, _, _| 0.0);
    let history = cluster(&tensor, 3, 100);
    assert_eq!((history.min_count(), history.max_count()), (0, 0));
    assert_eq!(history.cut(10).unwrap(), []);
    assert_partition(&tensor, &history, 10);
    assert!(history.costs.is_empty() && history.cost(0).is_none());
}

#[test]
fn single_lights_rows_and_frames_work() {
    for (lights, rows, frames) in
        [(1, 1, 1), (1, 5, 6), (9, 1, 6), (9, 5, 1), (1, 1, 6), (9, 1, 1), (1, 70, 1)]
    {
        let tensor = tensor_of(lights, rows, frames, |j, i, k| 0.1 + noise(j, i, k));
        let history = cluster(&tensor, 1, 1000);
        assert_eq!(history.max_count(), lights * frames);
        let one = cluster(&tensor, 1, 1);
        assert_eq!(one.cut(1).unwrap()[0].lights.len(), lights);
        // Columns of a single row are all parallel.
        assert_eq!(one.cost(1) == Some(0.0), rows == 1 || lights * frames == 1);
        assert_partition(&tensor, &history, 3.min(lights * frames));
    }
}

#[test]
fn identical_columns_cost_nothing_and_split_last() {
    let tensor = tensor_of(1000, 10, 1, |_, i, _| 0.1 + i as f32 / 3.0);
    let history = cluster(&tensor, 1, 10);
    assert_eq!(history.max_count(), 10);
    assert_eq!(history.costs, [0.0; 10]);
    assert_eq!(cluster(&tensor, 20, 2000).max_count(), 1000);

    // 1000 heavy identical lights and 4 faint different ones: the faint ones come apart first.
    let mixed = tensor_of(1004, 10, 1, |j, i, _| match j {
        0..1000 => 100.0,
        _ => 1e-3 * noise(j, i, 0),
    });
    let five = sorted(cluster(&mixed, 1, 5).cut(5).unwrap());
    assert_eq!(five[0].lights.len(), 1000);
    assert!(five[1..].iter().all(|c| c.lights.len() == 1));
}

#[test]
fn nearly_parallel_columns_have_positive_falling_costs() {
    for spread in [1e-2, 1e-4, 1e-6] {
        let tensor = tensor_of(300, 20, 3, |j, i, k| {
            (1.0 + i as f32) * (1.0 + spread * noise(j, i, k)) * (j + 1) as f32
        });
        let history = cluster(&tensor, 1, 200);
        assert_eq!(history.max_count(), 200);
        assert!(history.costs.iter().all(|&cost| cost > 0.0));
        assert!(history.costs.is_sorted_by(|a, b| a > b), "spread {spread}");
        let exact = double_sum(&tensor, &history.cut(150).unwrap());
        let cost = history.cost(150).unwrap();
        assert!((cost / exact - 1.0).abs() < 1e-3, "spread {spread}: {cost} {exact}");
    }
}

#[test]
fn scale_does_not_count() {
    let scaled = |scale: f32| {
        let plain = smooth(150, 30, 5);
        tensor_of(150, 30, 5, |j, i, k| scale * plain.column(j, k)[i])
    };
    let reference = cluster(&scaled(1.0), 20, 120);
    for power in [40, -40] {
        let history = cluster(&scaled(2f32.powi(power)), 20, 120);
        assert_eq!(history.splits, reference.splits);
        assert_eq!(history.lights, reference.lights);
        let factor = 4f64.powi(power);
        assert!(
            history.costs.iter().eq(reference
                .costs
                .iter()
                .map(|cost| cost * factor)
                .collect::<Vec<_>>()
                .iter())
        );
    }
    // W of 1e20 and more: W^2 does not fit into f32.
    for scale in [1e12, 1e-12, 1e20] {
        let history = cluster(&scaled(scale), 20, 120);
        assert_eq!(history.cut(120).unwrap(), reference.cut(120).unwrap());
        let factor = f64::from(scale).powi(2) * reference.cost(60).unwrap();
        assert!((history.cost(60).unwrap() / factor - 1.0).abs() < 1e-5);
    }
}

#[test]
fn the_largest_and_the_smallest_entries_stay_finite() {
    for scale in [f32::MAX, 1e-44] {
        let tensor = tensor_of(40, 60, 3, |j, i, k| scale * noise(j, i, k));
        let history = cluster(&tensor, 8, 60);
        assert_eq!(history.max_count(), 60);
        assert!(history.costs.iter().all(|cost| cost.is_finite() && *cost > 0.0));
        assert!(history.costs.is_sorted_by(|a, b| a > b));
        assert_partition(&tensor, &history, 60);
    }
}

#[test]
fn a_sun_is_isolated_and_the_lamps_cluster_as_without_it() {
    let lamps = smooth(200, 30, 1);
    let entry = |j: usize, i: usize| 1e-3 * lamps.column(j, 0)[i];
    let alone = tensor_of(200, 30, 1, |j, i, _| entry(j, i));
    let lit_by_sun =
        tensor_of(
            201,
            30,
            1,
            |j, i, _| if j == 200 { 1e9 * (1.0 + i as f32) } else { entry(j, i) },
        );
    for seed in 0..8 {
        let run =
            |tensor, count| cluster_columns(tensor, Mode::Divide, count, seed, &no_tick).unwrap();
        let (without, with) = (run(&alone, 40), run(&lit_by_sun, 41));
        // Not by the first split: the drawn line need not have the sun at its end, but it divides the lamps.
        let few = with.cut(6).unwrap();
        assert!(few.iter().any(|c| c.lights == [200]), "seed {seed}");
        let (without, with) = (without.cost(40).unwrap(), with.cost(41).unwrap());
        assert!((0.6..1.7).contains(&(with / without)), "seed {seed}: {with} {without}");
    }
    let both =
        cluster(&tensor_of(2, 2, 1, |j, i, _| if i == j { [1e9, 1e-3][j] } else { 0.0 }), 1, 1);
    assert!(
        (both.cost(1).unwrap() / 2e6 - 1.0).abs() < 1e-6,
        "two orthogonal columns cost 2 w_p w_q"
    );
}

#[test]
fn the_number_of_threads_does_not_count() {
    let tensor = smooth(700, 25, 8);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| cluster(&tensor, 40, 600))
    };
    let one = run(1);
    assert!(one.splits.chunks(3).any(|s| s[1] == 1) && one.splits.chunks(3).any(|s| s[1] == 0));
    assert_eq!(one, run(2));
    assert_eq!(one, run(5));
}

#[test]
fn damaged_settings_are_errors() {
    let tensor = smooth(9, 4, 6);
    let error = |settings: Settings| cluster_tensor(&tensor, &settings, &no_tick).unwrap_err();
    assert_eq!(error(settings(0, 5)), Error::Start);
    assert_eq!(error(settings(6, 5)), Error::Limit { limit: 5, start: 6 });
    assert_eq!(error(Settings { time_weight: 0.0, ..settings(1, 5) }), Error::TimeWeight(0.0));
    for cuts in [&[0][..], &[6], &[3, 3], &[4, 2]] {
        assert!(matches!(error(Settings { cuts, ..settings(1, 5) }), Error::Cut { frames: 6, .. }));
    }
    assert_eq!(
        error(Settings { cuts: &[2, 4], ..settings(2, 5) }),
        Error::Limit { limit: 5, start: 6 }
    );
}
