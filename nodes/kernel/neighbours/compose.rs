//! Searches in the 3x3 neighbourhood of a pixel: drift-free composition of maps, and anti-aliasing.

use super::features::{Features, NeighbourError, Padded, UNMAPPED, padded, padded_distance};
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
    let expected = target.padded().len();
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
                source.padded().get(centre as usize)?;
                nearest_around(source, [centre % source.width(), centre / source.width()], vector)
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
    nearest_around(low, [x, y], &padded(query))
}

/// The nearest among a pixel of the image and those around it.
fn nearest_around(features: &Features, [x, y]: [u32; 2], query: &Padded) -> Option<u32> {
    let vectors = features.padded();
    let width = features.width();
    let centre = y * width + x;
    let mut best = padded_distance(&vectors[centre as usize], query);
    if best < features.own(centre) {
        return Some(centre);
    }
    let mut nearest = if best < f32::INFINITY { centre } else { UNMAPPED };
    // At the edges a pixel is met twice, which changes nothing.
    for row in [y.saturating_sub(1), y, (y + 1).min(features.height() - 1)] {
        for column in [x.saturating_sub(1), x, (x + 1).min(width - 1)] {
            let pixel = row * width + column;
            let distance = padded_distance(&vectors[pixel as usize], query);
            // Selected, not branched to: which is nearest cannot be foreseen.
            let nearer = distance < best;
            nearest = if nearer { pixel } else { nearest };
            best = if nearer { distance } else { best };
        }
    }
    (nearest != UNMAPPED).then_some(nearest)
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
