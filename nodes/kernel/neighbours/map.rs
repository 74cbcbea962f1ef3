//! The pixel mapping between two frames.

use super::candidates::Candidates;
use super::features::{Features, UNMAPPED};
use super::pyramid::{Pyramid, Search};
use rayon::prelude::*;

/// Rows that are mapped as one piece of work, and the width of the tiles it is walked in: those of the pyramid's smallest nodes,
/// so that what one pixel's search has brought into the cache serves the next.
const TILE: usize = 8;

/// For each pixel of a target frame its nearest neighbour in a source frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// The source frame's pixel, or [`UNMAPPED`].
    pub pixel: Vec<u32>,
    /// The distance (not squared) of the two 9-vectors; infinite where unmapped.
    pub distance: Vec<f32>,
}

/// The pixel mapping M(source -> target) of section 4.4: it lives on the target frame and points into the source frame. The target
/// pixel's own place in the source image, in proportion where the sizes differ, is where ties are resolved to (see
/// [`Pyramid::nearest`]), so that equal frames give the identity. A target pixel is unmapped where it is invalid, where the source has no
/// valid pixel, and where the nearest is farther than `reject` (infinite to accept any distance; with a negative or NaN `reject`
/// all pixels are unmapped).
pub fn map(source: &Pyramid, target: &Features, reject: f32) -> Map {
    let (width, height) = (target.width() as usize, target.height() as usize);
    let mut pixel = vec![UNMAPPED; width * height];
    let mut distance = vec![f32::INFINITY; width * height];
    let bound = if reject >= 0.0 {
        (reject * reject).min(f32::MAX)
    } else {
        return Map { pixel, distance };
    };
    if width * height == 0 || source.width() == 0 || source.height() == 0 {
        return Map { pixel, distance };
    }
    let bands = pixel.par_chunks_mut(TILE * width).zip(distance.par_chunks_mut(TILE * width));
    bands.enumerate().for_each(|(band, (pixel, distance))| {
        Band { source, target, bound, first: band * TILE, pixel, distance }.fill();
    });
    Map { pixel, distance }
}

/// Rows of a map that are filled together.
struct Band<'a> {
    source: &'a Pyramid,
    target: &'a Features,
    /// The largest squared distance.
    bound: f32,
    /// The first row.
    first: usize,
    pixel: &'a mut [u32],
    distance: &'a mut [f32],
}

impl Band<'_> {
    fn fill(self) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has just been found to have what the function is compiled for.
            return unsafe { self.fill_with_avx2() };
        }
        self.fill_lanes();
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn fill_with_avx2(self) {
        self.fill_lanes();
    }

    #[inline(always)]
    fn fill_lanes(self) {
        let Self { source, target, bound, first, pixel, distance } = self;
        let (width, height) = (target.width() as usize, target.height() as usize);
        let rows = pixel.len() / width;
        // A pixel that has been mapped, and where to: those around it are guessed to have moved alike.
        let mut moved = None;
        let mut searches: Vec<(usize, Search)> = Vec::with_capacity(TILE * TILE);
        let mut candidates = Candidates::default();
        for left in (0..width).step_by(TILE) {
            searches.clear();
            let mut widest = 0.0f32;
            for row in 0..rows {
                let y = first + row;
                for x in left..width.min(left + TILE) {
                    let Some(vector) = target.valid((y * width + x) as u32) else { continue };
                    let home = [
                        (x as u64 * u64::from(source.width()) / width as u64) as u32,
                        (y as u64 * u64::from(source.height()) / height as u64) as u32,
                    ];
                    let guess = moved.map_or(home, |moved| source.beside(moved, [x, y]));
                    let mut search = source.begin(vector, home, guess, bound);
                    if searches.is_empty() {
                        source.finish(None, &mut search);
                    }
                    moved = search.found().map(|(nearest, _)| ([x, y], nearest)).or(moved);
                    widest = widest.max(search.distance);
                    searches.push((row * width + x, search));
                }
            }
            let queries = searches.iter().map(|(_, search)| &search.vector);
            let together = candidates.gather(source, queries, widest).then_some(&candidates);
            for (place, search) in &mut searches {
                source.finish(together, search);
                if let Some((nearest, squared)) = search.found() {
                    pixel[*place] = nearest;
                    distance[*place] = squared.sqrt();
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::box_room::{CENTRE, DIAGONAL, Picture, background, constant, picture, wall};
    use super::super::features::squared_distance;
    use super::*;
    use kiddo::{ImmutableKdTree, SquaredEuclidean};

    const EYE: [f64; 3] = [0.3, 1.4, 3.0];
    const NEARBY: [f64; 3] = [0.5, 1.5, 2.8];
    const NEVER: f32 = f32::INFINITY;

    fn features(picture: &Picture) -> Features {
        picture.features(CENTRE, DIAGONAL)
    }

    fn map_of(source: &Picture, target: &Picture, reject: f32) -> Map {
        map(&Pyramid::build(&features(source)), &features(target), reject)
    }

    #[test]
    fn static_frames_map_to_themselves() {
        let room = picture(90, 70, EYE, 1.4);
        assert!(room.valid.contains(&0) && room.valid.contains(&1));
        for still in [room, wall(67, 45, 0.0), constant(67, 45)] {
            for reject in [NEVER, 0.0] {
                let map = map_of(&still, &still, reject);
                for (pixel, &valid) in still.valid.iter().enumerate() {
                    let expected =
                        if valid == 0 { (UNMAPPED, f32::INFINITY) } else { (pixel as u32, 0.0) };
                    assert_eq!((map.pixel[pixel], map.distance[pixel]), expected);
                }
            }
        }
    }

    #[test]
    fn background_is_unmapped() {
        let (room, nothing) = (picture(33, 21, EYE, 0.0), background(33, 21));
        for (source, target) in [(&room, &nothing), (&nothing, &room), (&nothing, &nothing)] {
            let map = map_of(source, target, NEVER);
            assert_eq!(map.pixel, vec![UNMAPPED; 33 * 21]);
            assert_eq!(map.distance, vec![f32::INFINITY; 33 * 21]);
        }
        assert_eq!(map_of(&background(0, 4), &room, NEVER).pixel, vec![UNMAPPED; 33 * 21]);
        assert!(map_of(&room, &background(4, 0), NEVER).pixel.is_empty());
    }

    #[test]
    fn distances_are_those_of_a_kd_tree() {
        let (source, target) =
            (features(&picture(120, 90, EYE, 0.0)), features(&picture(120, 90, NEARBY, 0.3)));
        let points: Vec<[f32; 9]> =
            (0..120 * 90).filter_map(|pixel| source.vector(pixel)).collect();
        let tree: ImmutableKdTree<f32, 9> =
            ImmutableKdTree::new_from_slice(&points).expect("the points are finite");
        let map = map(&Pyramid::build(&source), &target, NEVER);
        for pixel in 0..120 * 90 {
            let query = target.vector(pixel).expect("the room fills the picture");
            let found = tree.query(&query).nearest_one::<SquaredEuclidean<f32>>().execute();
            let expected = squared_distance(&points[found.item as usize], &query).sqrt();
            assert_eq!(map.distance[pixel as usize], expected);
            let mapped = source.vector(map.pixel[pixel as usize]).expect("a neighbour is valid");
            assert_eq!(squared_distance(&mapped, &query).sqrt(), expected);
        }
    }

    #[test]
    fn searches_of_a_tile_are_those_of_its_pixels() {
        // Rounded, so that many pixels are equally near.
        let views = [picture(120, 90, EYE, 0.0), picture(100, 95, NEARBY, 0.3)].map(|mut view| {
            view.position.iter_mut().for_each(|p| *p = p.map(|c| (c * 8.0).round() / 8.0));
            features(&view)
        });
        let [source, target] = views;
        let source = Pyramid::build(&source);
        let map = map(&source, &target, NEVER);
        for pixel in 0..100 * 95 {
            let query = target.vector(pixel).expect("the room fills the picture");
            let home = pixel / 100 * 90 / 95 * 120 + pixel % 100 * 120 / 100;
            let (nearest, squared) = source.nearest(&query, home, UNMAPPED).expect("it does");
            let found = (map.pixel[pixel as usize], map.distance[pixel as usize]);
            assert_eq!(found, (nearest, squared.sqrt()), "{pixel}");
        }
    }

    #[test]
    fn rejection_unmaps_exactly_what_is_farther() {
        let (source, target) = (picture(60, 45, EYE, 0.0), picture(60, 45, NEARBY, 0.5));
        let free = map_of(&source, &target, NEVER);
        let reject = 0.02;
        let bound = map_of(&source, &target, reject);
        let far = free.distance.iter().filter(|distance| **distance > reject).count();
        assert!(far > 100 && far < 2000, "{far}");
        for pixel in 0..60 * 45 {
            if free.distance[pixel] <= reject {
                assert_eq!(
                    (bound.pixel[pixel], bound.distance[pixel]),
                    (free.pixel[pixel], free.distance[pixel])
                );
            } else {
                assert_eq!(bound.pixel[pixel], UNMAPPED);
            }
        }
        for nothing in [-1.0, f32::NAN] {
            assert!(map_of(&source, &target, nothing).pixel.iter().all(|pixel| *pixel == UNMAPPED));
        }
    }

    #[test]
    fn a_camera_cut_is_rejected() {
        let source = picture(60, 45, EYE, 0.0);
        let mut elsewhere = picture(60, 45, EYE, 0.0);
        elsewhere.position.iter_mut().for_each(|position| position[0] += 2.0 * DIAGONAL as f32);
        assert!(map_of(&source, &elsewhere, 0.25).pixel.iter().all(|pixel| *pixel == UNMAPPED));
        assert!(map_of(&source, &elsewhere, NEVER).pixel.iter().all(|pixel| *pixel != UNMAPPED));
    }

    #[test]
    fn scaled_and_moved_scenes_have_the_same_maps() {
        let views = [picture(80, 60, EYE, 0.0), picture(80, 60, NEARBY, 0.1)];
        let map_with = |round: f64, scale: f64, shift: f64| {
            let [source, target] = views.each_ref().map(|view| {
                let coordinate = |c: f32| {
                    let c = f64::from(c);
                    ((if round > 0.0 { (c / round).round() * round } else { c }) * scale + shift)
                        as f32
                };
                let moved = Picture {
                    position: view.position.iter().map(|p| p.map(coordinate)).collect(),
                    normal: view.normal.clone(),
                    albedo: view.albedo.clone(),
                    valid: view.valid.clone(),
                    ..*view
                };
                moved.features(CENTRE.map(|c| c * scale + shift), DIAGONAL * scale)
            });
            map(&Pyramid::build(&source), &target, NEVER)
        };
        let plain = map_with(0.0, 1.0, 0.0);
        assert_eq!(map_with(0.0, 1e6, 0.0).pixel, plain.pixel);
        assert_eq!(map_with(0.0, 1e-6, 0.0).pixel, plain.pixel);
        // Single-precision positions near 1e6 are spaced by 1/16; what they can hold is kept to the bit.
        let coarse = map_with(0.0625, 1.0, 0.0);
        assert_eq!(map_with(0.0625, 1.0, 1e6), coarse);
        assert!(coarse.pixel.iter().enumerate().any(|(pixel, source)| pixel as u32 != *source));
    }

    #[test]
    fn sizes_may_differ_and_ties_go_to_the_place_in_proportion() {
        let map = map_of(&constant(20, 10), &constant(60, 30), NEVER);
        for pixel in 0..60 * 30 {
            assert_eq!(map.pixel[pixel], (pixel / 60 / 3 * 20 + pixel % 60 / 3) as u32);
        }
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        let (source, target) =
            (features(&picture(150, 101, EYE, 0.0)), features(&picture(151, 100, NEARBY, 0.2)));
        let [one, two] = [1, 2].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("threads can be had");
            pool.install(|| map(&Pyramid::build(&source), &target, NEVER))
        });
        assert_eq!(one.pixel, two.pixel);
        assert!(one.distance.iter().zip(&two.distance).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}
