//! The line in information space along which the lights of a cluster are ordered (Hašan 2008, section 4.3.2, "Light split").

use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;

use super::cost::{ROUNDING, Rectangle};
use super::{Beat, Tensor, lanes, unit};

/// Second lights drawn before the line is taken to the light farthest from the first.
const REDRAWS: usize = 8;
/// Lights between two calls of `beat`.
const BEAT: usize = 64;

/// The direction of the line through the unfolded slabs of normalized columns of two lights, drawn with probability proportional
/// to their `weights` over the frames of the cluster: `[frame][row]`. The second light is drawn again if the two are parallel,
/// at last it is the one farthest from the first. All zero if no two lights differ.
pub fn direction<E>(
    tensor: &Tensor,
    rectangle: &Rectangle,
    weights: &[f64],
    random: &mut Pcg64Mcg,
    beat: &Beat<E>,
) -> Result<Vec<f64>, E> {
    let none = vec![0.0; rectangle.frames.len() * tensor.rows()];
    let Some(first) = draw(weights, None, random) else { return Ok(none) };
    for _ in 0..REDRAWS {
        let Some(second) = draw(weights, Some(first), random) else { return Ok(none) };
        if let Some(direction) = through(tensor, rectangle, first, second) {
            return Ok(direction);
        }
    }
    let second = farthest(tensor, rectangle, weights, first, beat)?;
    Ok(through(tensor, rectangle, first, second).unwrap_or(none))
}

/// From one light (a position in the cluster) to the other; `None` if they differ by no more than the rounding of their entries.
pub fn through(
    tensor: &Tensor,
    rectangle: &Rectangle,
    first: usize,
    second: usize,
) -> Option<Vec<f64>> {
    let mut direction = normalized(tensor, rectangle, second);
    for (to, from) in direction.iter_mut().zip(normalized(tensor, rectangle, first)) {
        *to -= from;
    }
    let length: f64 = direction.iter().map(|x| x * x).sum();
    (length > ROUNDING * rectangle.frames.len() as f64).then_some(direction)
}

/// A position drawn with probability proportional to its weight, never `without`; `None` if no other has weight.
fn draw(weights: &[f64], without: Option<usize>, random: &mut Pcg64Mcg) -> Option<usize> {
    let others = || {
        let all = weights.iter().copied().enumerate();
        all.filter(move |&(at, weight)| weight > 0.0 && Some(at) != without)
    };
    // Summed afresh: taking the first light's weight away would leave nothing beside a far brighter one.
    let mut left = unit(random.next_u64()) * others().map(|(_, weight)| weight).sum::<f64>();
    let mut last = None;
    for (at, weight) in others() {
        last = Some(at);
        left -= weight;
        if left < 0.0 {
            break;
        }
    }
    last
}

fn normalized(tensor: &Tensor, rectangle: &Rectangle, at: usize) -> Vec<f64> {
    let light = rectangle.lights[at] as usize;
    let norms = tensor.norms(light, rectangle.frames.clone());
    let columns = tensor.slab(light, rectangle.frames.clone()).chunks(tensor.rows());
    let scaled = columns.zip(norms).flat_map(|(column, &w)| {
        let scale = inverse(w);
        column.iter().map(move |&x| f64::from(x) * scale)
    });
    scaled.collect()
}

fn farthest<E>(
    tensor: &Tensor,
    rectangle: &Rectangle,
    weights: &[f64],
    from: usize,
    beat: &Beat<E>,
) -> Result<usize, E> {
    let centre = normalized(tensor, rectangle, from);
    let mut best = (from, 0.0);
    for (at, &light) in rectangle.lights.iter().enumerate() {
        if at % BEAT == 0 {
            beat()?;
        }
        if weights[at] > 0.0 {
            let norms = tensor.norms(light as usize, rectangle.frames.clone());
            let columns =
                tensor.slab(light as usize, rectangle.frames.clone()).chunks(tensor.rows());
            let centres = centre.chunks(tensor.rows());
            let apart: f64 = columns
                .zip(centres)
                .zip(norms)
                .map(|((column, centre), &w)| lanes::distance(column, inverse(w), centre))
                .sum();
            if apart > best.1 {
                best = (at, apart);
            }
        }
    }
    Ok(best.0)
}

/// The factor that normalizes a column; a column of zeros stays zero.
pub fn inverse(norm: f64) -> f64 {
    if norm > 0.0 { 1.0 / norm } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{never, tensor_of};
    use super::super::{Draw, random};
    use super::*;

    #[test]
    fn draws_follow_the_weights() {
        let mut random = random(5, Draw::Line, 0);
        let mut counts = [0; 4];
        for _ in 0..4000 {
            counts[draw(&[1.0, 0.0, 2.0, 1.0], None, &mut random).unwrap()] += 1;
        }
        assert_eq!(counts[1], 0);
        assert!(
            (900..1100).contains(&counts[0]) && (1900..2100).contains(&counts[2]),
            "{counts:?}"
        );
        for _ in 0..100 {
            let other = draw(&[1e12, 1e-3, 0.0, 3e-3], Some(0), &mut random).unwrap();
            assert!(other == 1 || other == 3);
        }
        assert_eq!(draw(&[1.0, 0.0], Some(0), &mut random), None);
    }

    #[test]
    fn one_differing_light_among_parallel_ones_is_found() {
        // The drawn lights are parallel with near certainty; light 700 alone differs, and is very dim.
        let tensor = tensor_of(1000, 3, 2, |j, i, _| match (j, i) {
            (700, 0) => 1e-12,
            (700, _) => 0.0,
            _ => 1.0 + i as f32,
        });
        let lights: Vec<u32> = (0..1000).collect();
        let all = Rectangle { lights: &lights, frames: 0..2 };
        let weights: Vec<f64> = (0..1000).map(|j| tensor.norms(j, 0..2).iter().sum()).collect();
        let direction =
            direction(&tensor, &all, &weights, &mut random(1, Draw::Line, 2), &never).unwrap();
        let expected = through(&tensor, &all, 0, 700).unwrap();
        assert_eq!(direction, expected);

        let same = tensor_of(9, 3, 1, |j, i, _| (j + 1) as f32 * (1.0 + i as f32) / 3.0);
        let all = Rectangle { lights: &lights[..9], frames: 0..1 };
        let weights = [1.0; 9];
        let none = super::direction(&same, &all, &weights, &mut random(1, Draw::Line, 2), &never);
        assert_eq!(none.unwrap(), [0.0; 3]);
    }
}
