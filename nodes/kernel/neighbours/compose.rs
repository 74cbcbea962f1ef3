//! Searches in the 3x3 neighbourhood of a pixel: drift-free composition of maps, and anti-aliasing.

use super::features::{
    Features, NeighbourError, UNMAPPED, Vector, squared_distance, squared_distances,
};
use glam::Vec4;
use rayon::prelude::*;

/// Pixels that are composed as one piece of work.
const CHUNK: usize = 4096;

/// Composes maps without drift. `onward` is the map so far, from frame k0 to frame k (it lives on k and points into k0), `step` is
/// M(k -> k+1); the answer lives on k+1 and points into k0. `source` holds the vectors of k0, `target` those of k+1.
///
/// Composing indices alone rounds sub-pixel motion away in every step. So the composed pixel is only where a search of its 3x3
/// neighbourhood in the source begins, for the vector of the target's pixel itself; the error then stays that of one rounding.
/// Where several are equally near, the composed pixel wins, then the smallest index. A pixel is [`UNMAPPED`] where `step` or
/// `onward` is, where one of them points beyond its frame, and where the target's or all nine of the source's pixels are invalid.
///
/// Fails when `step` does not have one element for each of the target's pixels.
pub fn compose(
    onward: &[u32],
    step: &[u32],
    source: &Features,
    target: &Features,
) -> Result<Vec<u32>, NeighbourError> {
    let expected = target.vectors().len();
    if step.len() != expected {
        return Err(NeighbourError::Length { what: "step", found: step.len(), expected });
    }
    let mut composed = vec![UNMAPPED; expected];
    composed.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, composed)| {
        for (offset, composed) in composed.iter_mut().enumerate() {
            let pixel = chunk * CHUNK + offset;
            let nearest = || {
                let vector = target.valid(pixel as u32)?;
                let centre = *onward.get(step[pixel] as usize)?;
                let distance = squared_distance(source.vectors().get(centre as usize)?, vector);
                if distance < source.own(centre) {
                    return Some(centre);
                }
                Some(nearest_around(source, centre, vector, distance))
            };
            *composed = nearest().unwrap_or(UNMAPPED);
        }
    });
    Ok(composed)
}

/// The pixel of a low-resolution image whose vector is nearest to `query` (a weighted 9-vector) among the 3x3 pixels around `(x, y)`,
/// after the anti-aliasing of section 5. Where several are equally near, the centre wins, then the smallest index. None when
/// `(x, y)` lies beyond the image, when none of the nine is valid, or when the query is not finite.
pub fn nearest_of_3x3(low: &Features, (x, y): (u32, u32), query: &[f32; 9]) -> Option<u32> {
    if x >= low.width() || y >= low.height() {
        return None;
    }
    let centre = y * low.width() + x;
    let distance = squared_distance(&low.vectors()[centre as usize], query);
    if distance < low.own(centre) {
        return Some(centre);
    }
    Some(nearest_around(low, centre, query, distance)).filter(|nearest| *nearest != UNMAPPED)
}

/// The nearest to `query` among a pixel, whose squared distance is given, and those around it; [`UNMAPPED`] where none
/// is at a finite distance.
fn nearest_around(features: &Features, centre: u32, query: &Vector, distance: f32) -> u32 {
    let (vectors, [width, height]) = (features.vectors(), [features.width(), features.height()]);
    let (x, y) = (centre % width, centre / width);
    let [left, right] = [x.saturating_sub(1), (x + 1).min(width - 1)];
    let above = y.saturating_sub(1) * width;
    let below = (y + 1).min(height - 1) * width;
    let here = y * width;
    // In the order of their indices. At the edges some are met twice, which changes nothing.
    let upper = [above + left, above + x, above + right, here + left];
    let lower = [here + right, below + left, below + x, below + right];
    let [a, b] =
        [squared_distances(vectors, upper, query), squared_distances(vectors, lower, query)];
    let least = a.min(b).min_element();
    let is_least = Vec4::splat(least);
    let first = a.cmple(is_least).bitmask() | b.cmple(is_least).bitmask() << 4;
    let nearer = [upper, lower].as_flattened()[first.trailing_zeros() as usize % 8];
    // Selected, not branched to: which is nearest cannot be foreseen.
    let nearest = if distance < f32::INFINITY { centre } else { UNMAPPED };
    if least < distance { nearer } else { nearest }
}

#[cfg(test)]
mod tests {
    use super::super::box_room::{CENTRE, DIAGONAL, background, constant, picture, wall};
    use super::super::{Pyramid, map};
    use super::*;

    const NEVER: f32 = f32::INFINITY;

    #[test]
    fn a_slow_pan_does_not_drift() {
        let (width, height, frames, speed) = (96, 24, 40, 0.4);
        let features: Vec<Features> = (0..=frames)
            .map(|k| wall(width, height, f64::from(k) * speed).features(CENTRE, DIAGONAL))
            .collect();
        let steps: Vec<Vec<u32>> = features
            .windows(2)
            .map(|pair| map(&Pyramid::build(&pair[0]), &pair[1], NEVER).pixel)
            .collect();
        let identity: Vec<u32> = (0..width * height).collect();
        let drift = |onward: &[u32]| {
            let moved = f64::from(frames) * speed;
            let seen = (0..width * height)
                .filter(|pixel| f64::from(pixel % width) + moved < f64::from(width - 1));
            let errors = seen.map(|pixel| {
                let from = onward[pixel as usize];
                assert_eq!(from / width, pixel / width);
                (f64::from(from % width) - f64::from(pixel % width) - moved).abs()
            });
            errors.fold(0.0, f64::max)
        };
        let mut indices = identity.clone();
        let mut onward = identity;
        for (k, step) in steps.iter().enumerate() {
            indices = step.iter().map(|pixel| indices[*pixel as usize]).collect();
            onward =
                compose(&onward, step, &features[0], &features[k + 1]).expect("the lengths agree");
        }
        assert!(drift(&indices) > 15.0, "indices alone drift by {}", drift(&indices));
        assert!(drift(&onward) <= 0.5, "composed maps drift by {}", drift(&onward));
    }

    #[test]
    fn static_maps_compose_to_the_identity() {
        for still in [picture(50, 40, [0.3, 1.4, 3.0], 1.4), wall(50, 40, 0.0), constant(50, 40)] {
            let features = still.features(CENTRE, DIAGONAL);
            let step = map(&Pyramid::build(&features), &features, NEVER).pixel;
            assert_eq!(compose(&step, &step, &features, &features), Ok(step));
        }
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        let source = picture(150, 101, [0.3, 1.4, 3.0], 0.0).features(CENTRE, DIAGONAL);
        let target = picture(150, 101, [0.5, 1.5, 2.8], 0.2).features(CENTRE, DIAGONAL);
        let step: Vec<u32> = (0..150 * 101).rev().collect();
        let onward = map(&Pyramid::build(&source), &target, NEVER).pixel;
        let [one, two] = [1, 2].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("threads can be had");
            pool.install(|| compose(&onward, &step, &source, &target))
        });
        assert_eq!(one, two);
    }

    #[test]
    fn unmapped_stays_unmapped() {
        let features = wall(4, 2, 0.0).features(CENTRE, DIAGONAL);
        let nothing = background(4, 2).features(CENTRE, DIAGONAL);
        let identity: Vec<u32> = (0..8).collect();
        assert_eq!(
            compose(&identity, &[0, UNMAPPED, 2, 900, 4, 5, 6, 7], &features, &features),
            Ok(vec![0, UNMAPPED, 2, UNMAPPED, 4, 5, 6, 7])
        );
        assert_eq!(
            compose(&[0, 1, UNMAPPED, 3, 900], &identity, &features, &features),
            Ok(vec![0, 1, UNMAPPED, 3, UNMAPPED, UNMAPPED, UNMAPPED, UNMAPPED])
        );
        assert_eq!(compose(&identity, &identity, &nothing, &features), Ok(vec![UNMAPPED; 8]));
        assert_eq!(compose(&identity, &identity, &features, &nothing), Ok(vec![UNMAPPED; 8]));
        assert_eq!(
            compose(&identity, &identity[1..], &features, &features),
            Err(NeighbourError::Length { what: "step", found: 7, expected: 8 })
        );
    }

    #[test]
    fn finds_the_nearest_of_nine() {
        let low = wall(5, 4, 0.0).features(CENTRE, DIAGONAL);
        let of = |x: u32, y: u32| low.vector(y * 5 + x).expect("the wall fills the picture");
        for (y, x) in (0..4).flat_map(|y| (0..5).map(move |x| (y, x))) {
            for (v, u) in (0..4u32).flat_map(|v| (0..5u32).map(move |u| (v, u))) {
                // The wall's vectors are a square grid, so the nearest of the nine is where (u, v) is clamped to.
                let expected = v.clamp(y.max(1) - 1, y + 1) * 5 + u.clamp(x.max(1) - 1, x + 1);
                assert_eq!(nearest_of_3x3(&low, (x, y), &of(u, v)), Some(expected));
            }
        }
        assert_eq!(nearest_of_3x3(&low, (5, 0), &of(0, 0)), None);
        assert_eq!(nearest_of_3x3(&low, (0, 4), &of(0, 0)), None);
        assert_eq!(nearest_of_3x3(&low, (0, 0), &[f32::NAN; 9]), None);
        assert_eq!(
            nearest_of_3x3(&background(5, 4).features(CENTRE, DIAGONAL), (1, 1), &of(0, 0)),
            None
        );
        assert_eq!(
            nearest_of_3x3(&constant(5, 4).features(CENTRE, DIAGONAL), (1, 1), &of(0, 0)),
            Some(6)
        );
    }
}
