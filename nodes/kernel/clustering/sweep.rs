//! One pass over a cluster for all that its splits need, and the cost at every position of an ordering.

use std::ops::Range;

use super::cost::{self, Rectangle};
use super::lanes::{self, GROUP};
use super::line::inverse;
use super::{Beat, Tensor};

/// Groups of lights between two calls of `beat`.
const BEAT: usize = 16;
/// Positions between two calls of `beat`.
const POSITIONS: usize = 4096;

/// The weights of a cluster.
pub struct Weights {
    /// Sum of the norms over the frames, for each light.
    pub lights: Vec<f64>,
    /// Sum of the norms over the lights, for each frame.
    pub frames: Vec<f64>,
}

impl Weights {
    pub fn of(tensor: &Tensor, rectangle: &Rectangle) -> Weights {
        let mut frames = vec![0.0; rectangle.frames.len()];
        let weight = |&light: &u32| {
            let norms = tensor.norms(light as usize, rectangle.frames.clone());
            lanes::add(&mut frames, norms);
            lanes::sum(norms)
        };
        Weights { lights: rectangle.lights.iter().map(weight).collect(), frames }
    }
}

/// What one pass over a cluster gives.
pub struct Sums {
    /// The place of each light on the line.
    pub places: Vec<f64>,
    /// The columns summed over the frames, `[light][row]`; empty for one frame, where the columns themselves serve.
    pub lights: Vec<f64>,
    /// The columns summed over the lights, `[frame][row]`; empty for one light, where the columns themselves serve.
    pub frames: Vec<f64>,
}

impl Sums {
    /// The sums of a cluster; `direction` is that of the line, `[frame][row]`.
    pub fn of<E>(
        tensor: &Tensor,
        rectangle: &Rectangle,
        direction: &[f64],
        beat: &Beat<E>,
    ) -> Result<Sums, E> {
        let (count, frames) = (rectangle.lights.len(), rectangle.frames.len());
        if count == 1 {
            return Ok(Sums { places: vec![0.0], lights: vec![], frames: vec![] });
        }
        let by_light = if frames > 1 { count * tensor.rows() } else { 0 };
        let mut sums = Sums {
            places: vec![0.0; count],
            lights: vec![0.0; by_light],
            frames: vec![0.0; frames * tensor.rows()],
        };
        for first in (0..count).step_by(BEAT * GROUP) {
            beat()?;
            let block = first..count.min(first + BEAT * GROUP);
            add_block(&mut sums, tensor, rectangle, direction, block);
        }
        Ok(sums)
    }

    #[inline(always)]
    fn block(
        &mut self,
        tensor: &Tensor,
        rectangle: &Rectangle,
        direction: &[f64],
        block: Range<usize>,
    ) {
        let whole = block.start + block.len() / GROUP * GROUP;
        for first in (block.start..whole).step_by(GROUP) {
            self.group::<GROUP>(tensor, rectangle, direction, first);
        }
        for first in whole..block.end {
            self.group::<1>(tensor, rectangle, direction, first);
        }
    }

    #[inline(always)]
    fn group<const G: usize>(
        &mut self,
        tensor: &Tensor,
        rectangle: &Rectangle,
        direction: &[f64],
        first: usize,
    ) {
        let rows = tensor.rows();
        let lights: [usize; G] = std::array::from_fn(|g| rectangle.lights[first + g] as usize);
        let slabs = lights.map(|light| tensor.slab(light, rectangle.frames.clone()));
        let norms = lights.map(|light| tensor.norms(light, rectangle.frames.clone()));
        // Lights of a cluster lie anywhere in the tensor, where the processor does not foresee them.
        let next: [*const f32; G] = std::array::from_fn(|g| {
            let light = rectangle.lights.get(first + G + g);
            light.map_or(std::ptr::null(), |&light| {
                tensor.slab(light as usize, rectangle.frames.clone()).as_ptr()
            })
        });
        for k in 0..rectangle.frames.len() {
            let next = next.map(|slab| slab.wrapping_add(k * rows));
            let columns = slabs.map(|slab| &slab[k * rows..][..rows]);
            let direction = &direction[k * rows..][..rows];
            let frame = &mut self.frames[k * rows..][..rows];
            let dots = if self.lights.is_empty() {
                lanes::gather::<G, false>(columns, direction, frame, &mut [], next)
            } else {
                let lights = &mut self.lights[first * rows..][..G * rows];
                lanes::gather::<G, true>(columns, direction, frame, lights, next)
            };
            for g in 0..G {
                self.places[first + g] += dots[g] * inverse(norms[g][k]);
            }
        }
    }

    /// The lights in the order of their places, equal places by `weights` and then by number: lights that share no row with the
    /// line all lie at its origin, and there the numbering of the lights should not decide.
    pub fn order(&self, weights: &[f64]) -> Vec<u32> {
        let mut order: Vec<u32> = (0..self.places.len() as u32).collect();
        order.sort_unstable_by(|&a, &b| {
            let [x, y] = [a as usize, b as usize];
            let by_place = self.places[x].total_cmp(&self.places[y]);
            by_place.then(weights[x].total_cmp(&weights[y])).then(a.cmp(&b))
        });
        order
    }
}

lanes::wide! {
    fn add_block(
        sums: &mut Sums,
        tensor: &Tensor,
        rectangle: &Rectangle,
        direction: &[f64],
        block: Range<usize>
    ) = Sums::block
}

/// A position of an ordering, with the weights and the costs of what lies before and from it on.
#[derive(Debug, Clone, Copy)]
pub struct Position {
    pub at: usize,
    pub weights: [f64; 2],
    pub costs: [f64; 2],
}

impl Position {
    pub fn cost(&self) -> f64 {
        self.costs[0] + self.costs[1]
    }
}

/// The position of least cost among those with weight on both sides, the first of equals. `weights` and `vector(at)`, of `rows`
/// entries, are the W and s of the elements in order.
///
/// Both sides are summed from their own end: the difference from the total would be lost beside a far brighter light.
pub fn best<'a, T: Copy + Into<f64> + 'a, E>(
    weights: &[f64],
    rows: usize,
    vector: impl Fn(usize) -> &'a [T],
    beat: &Beat<E>,
) -> Result<Option<Position>, E> {
    let mut before = vec![(0.0, 0.0); weights.len()];
    let mut sum = vec![0.0; rows];
    let mut weight = 0.0;
    for at in 1..weights.len() {
        if at % POSITIONS == 0 {
            beat()?;
        }
        weight += weights[at - 1];
        before[at] = (weight, cost::plain(weight, lanes::accumulate(&mut sum, vector(at - 1))));
    }
    sum.fill(0.0);
    weight = 0.0;
    let mut best: Option<Position> = None;
    for at in (1..weights.len()).rev() {
        if at % POSITIONS == 0 {
            beat()?;
        }
        weight += weights[at];
        let costs = [before[at].1, cost::plain(weight, lanes::accumulate(&mut sum, vector(at)))];
        let position = Position { at, weights: [before[at].0, weight], costs };
        let lit = before[at].0 > 0.0 && weight > 0.0;
        if lit && best.is_none_or(|best| position.cost() <= best.cost()) {
            best = Some(position);
        }
    }
    Ok(best)
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{never, noise, smooth};
    use super::*;

    #[test]
    fn the_pass_gives_the_plain_sums() {
        let tensor = smooth(70, 11, 5);
        let lights: Vec<u32> = (0..67).map(|j| j + 2).collect();
        for frames in [0..5, 1..3, 4..5] {
            let rectangle = Rectangle { lights: &lights, frames: frames.clone() };
            let direction: Vec<f64> =
                (0..11 * frames.len()).map(|at| f64::from(noise(at, 3, 3)) - 0.5).collect();
            let sums = Sums::of(&tensor, &rectangle, &direction, &never).unwrap();
            let mut by_frame = vec![0.0; frames.len() * 11];
            for (at, &light) in lights.iter().enumerate() {
                let mut by_light = vec![0.0; 11];
                let mut place = 0.0;
                for k in 0..frames.len() {
                    let column = tensor.column(light as usize, frames.start + k);
                    lanes::add(&mut by_light, column);
                    lanes::add(&mut by_frame[k * 11..][..11], column);
                    let dot: f64 = column
                        .iter()
                        .zip(&direction[k * 11..])
                        .map(|(&x, d)| f64::from(x) * d)
                        .sum();
                    place += dot * inverse(tensor.norms(light as usize, 0..5)[frames.start + k]);
                }
                assert!((sums.places[at] - place).abs() < 1e-13);
                assert!(frames.len() == 1 || sums.lights[at * 11..][..11] == by_light);
            }
            assert_eq!(sums.frames, by_frame);
        }
    }

    #[test]
    fn the_best_position_is_that_of_the_exhaustive_search() {
        let vectors: Vec<Vec<f32>> = (0..40)
            .map(|j| (0..7).map(|i| noise(j, i, 1) * if j < 17 { i as f32 } else { 2.0 }).collect())
            .collect();
        let weights: Vec<f64> = vectors.iter().map(|v| lanes::squares(v).sqrt()).collect();
        let cost = |from: usize, to: usize| {
            let mut sum = vec![0.0; 7];
            vectors[from..to].iter().for_each(|v| lanes::add(&mut sum, v));
            weights[from..to].iter().sum::<f64>().powi(2) - sum.iter().map(|x| x * x).sum::<f64>()
        };
        let found = best(&weights, 7, |at| vectors[at].as_slice(), &never).unwrap().unwrap();
        for at in 1..40 {
            assert!(found.cost() <= cost(0, at) + cost(at, 40) + 1e-9);
        }
        assert!((found.costs[0] - cost(0, found.at)).abs() < 1e-9);
        assert!((found.costs[1] - cost(found.at, 40)).abs() < 1e-9);
    }

    #[test]
    fn both_sides_have_weight() {
        let vectors = [[0.0f32], [0.0], [1.0], [0.0], [0.0]];
        let weights = vectors.map(|[x]| f64::from(x));
        assert!(best(&weights, 1, |at| &vectors[at][..], &never).unwrap().is_none());
        let two = [0.0, 1.0, 0.0, 2.0, 0.0];
        let found = best(&two, 1, |at| &two[at..at + 1], &never).unwrap().unwrap();
        assert_eq!((found.at, found.weights), (2, [1.0, 2.0]));
    }
}
