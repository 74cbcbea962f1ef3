//! The axes along which vectors differ most: the few numbers along them bound distances from below. With them goes how far
//! a vector lies off all of the axes, which differs by at most the distance, too: it tells a vector that is far from every
//! entry, but not along the axes, from one that is near.

use super::best::LEAST;
use super::centres::Centres;
use super::lanes::{Eight, GROUP, Lanes, WIDTH, padded, wide};

/// Vectors that the axes are fitted to, about.
const SAMPLE: usize = 2048;
/// Rounds of subspace iteration: the axes need not be exact.
const ROUNDS: usize = 16;
/// What is left of an axis by orthogonalization is rounding if it is shorter by this factor.
const NOTHING: f64 = 1e-9;

/// Axes at most; the eighth number is the distance off them.
const AXES: usize = WIDTH - 1;

/// Up to seven orthonormal axes through the median, those along which vectors differ most.
pub struct Principal {
    /// By number, padded. The mean would be drawn away by one bright vector, and rounding is in proportion to the distance from
    /// here.
    median: Vec<Eight>,
    /// One number of all axes, for each number of a vector; zeros where there are fewer axes.
    across: Vec<Eight>,
    /// The same axes one by one, each padded.
    along: Vec<Eight>,
}

impl Principal {
    /// Fits the axes to padded vectors of `dims` numbers.
    pub fn new(centres: &[Eight], dims: usize) -> Self {
        let vectors = centres.chunks_exact(dims.div_ceil(WIDTH));
        let step = (vectors.len() / SAMPLE).max(1);
        let sample = vectors.step_by(step);
        let median = median(sample.clone(), dims);
        let scatter = scatter(sample, &median, dims);
        // Any axes that are orthogonal to none of those wanted.
        let start = |i: usize| (i as u32).wrapping_mul(0x9e37_79b9) as i32;
        let mut axes: [Vec<f64>; AXES] =
            std::array::from_fn(|a| (0..dims).map(|i| start(a * dims + i).into()).collect());
        for _ in 0..ROUNDS {
            for axis in &mut axes {
                *axis = scatter.chunks_exact(dims).map(|row| dot(row, axis)).collect();
            }
            orthonormalize(&mut axes);
        }
        let of = |i| {
            Eight(std::array::from_fn(|a| {
                axes.get(a).map_or(0.0, |axis: &Vec<f64>| axis[i] as f32)
            }))
        };
        let across = (0..dims).map(of).collect();
        let single = |axis: &Vec<f64>| axis.iter().map(|x| *x as f32).collect::<Vec<_>>();
        let along = axes.iter().flat_map(|axis| padded(&single(axis), dims, 1.0)).collect();
        Principal { median: padded(&median, dims, 1.0), across, along }
    }

    /// The numbers of padded `x` along the axes, from the median, and last its distance off them. Between two vectors they differ
    /// by at most the vectors' distance.
    #[inline(always)]
    pub fn project<L: Lanes>(&self, x: &[Eight]) -> Eight {
        let mut sum = L::splat(0.0);
        for ((across, x), median) in self.across.chunks(WIDTH).zip(x).zip(&self.median) {
            let apart = L::load(x).sub(L::load(median)).store();
            for (across, x) in across.iter().zip(apart) {
                sum = sum.add(L::splat(x).mul(L::load(across)));
            }
        }
        let mut numbers = sum.store();
        let mut square = L::splat(0.0);
        for (i, (x, median)) in x.iter().zip(&self.median).enumerate() {
            let mut off = L::load(x).sub(L::load(median));
            for (number, axis) in numbers.iter().zip(self.along.chunks_exact(self.median.len())) {
                off = off.sub(L::splat(*number).mul(L::load(&axis[i])));
            }
            square = square.add(off.mul(off));
        }
        numbers[AXES] = L::sums([square; GROUP])[0].sqrt();
        Eight(numbers)
    }
}

/// Entries along their principal axes.
pub struct Projected {
    /// The axes.
    pub axes: Principal,
    /// The entries' numbers along them.
    pub points: Vec<Eight>,
}

impl Projected {
    /// Projects entries.
    pub fn new(axes: Principal, centres: &Centres) -> Self {
        let mut projected = Projected { axes, points: Vec::new() };
        projected.follow(centres);
        projected
    }

    /// Projects other entries to the same axes.
    pub fn follow(&mut self, centres: &Centres) {
        self.points.resize(centres.count, Eight::default());
        project_all(&self.axes, &centres.padded, &mut self.points);
    }

    /// How much farther than it is a vector with these numbers may seem from an entry that is as `near` to it.
    #[inline(always)]
    pub fn slack(&self, point: &Eight, near: f32) -> f32 {
        // A sum of n products is off by at most n half epsilons of the product of lengths, the seven of them by a root of seven of
        // that. So is the distance off the axes, of which seven more products are taken. The entry is at most `near` farther from
        // the median than the vector.
        let relative = 2.0 * f32::EPSILON * (self.axes.across.len() + 12) as f32;
        let square = |sum: f32, x: &f32| sum + x * x;
        relative * (2.0 * point.0.iter().fold(0.0, square).sqrt() + near) + LEAST
    }
}

wide! { fn project_all(axes: &Principal, padded: &[Eight], points: &mut [Eight]) = project }

#[inline(always)]
fn project<L: Lanes>(axes: &Principal, padded: &[Eight], points: &mut [Eight]) {
    let lanes = padded.len() / points.len();
    for (x, point) in padded.chunks_exact(lanes).zip(points) {
        *point = axes.project::<L>(x);
    }
}

/// The median of each number.
fn median<'a>(vectors: impl Iterator<Item = &'a [Eight]> + Clone, dims: usize) -> Vec<f32> {
    let middle = |i: usize| {
        let mut numbers: Vec<f32> =
            vectors.clone().map(|vector| vector[i / WIDTH].0[i % WIDTH]).collect();
        let half = numbers.len() / 2;
        *numbers.select_nth_unstable_by(half, f32::total_cmp).1
    };
    (0..dims).map(middle).collect()
}

/// Sums of products of differences from a vector.
fn scatter<'a>(vectors: impl Iterator<Item = &'a [Eight]>, from: &[f32], dims: usize) -> Vec<f64> {
    let mut scatter = vec![0.0; dims * dims];
    for vector in vectors {
        let numbers = vector.iter().flat_map(|x| x.0).zip(from);
        let apart: Vec<f64> = numbers.map(|(x, from)| f64::from(x) - f64::from(*from)).collect();
        for (row, x) in scatter.chunks_exact_mut(dims).zip(&apart) {
            row.iter_mut().zip(&apart).for_each(|(sum, y)| *sum += x * y);
        }
    }
    scatter
}

/// Makes axes orthogonal to those before and of length 1; those that depend on others become zero.
fn orthonormalize(axes: &mut [Vec<f64>]) {
    for at in 0..axes.len() {
        let (before, axis) = axes.split_at_mut(at);
        let axis = &mut axis[0];
        let length = dot(axis, axis).sqrt();
        // The second time removes what rounding left the first time.
        for _ in 0..2 {
            for other in &*before {
                let along = dot(axis, other);
                axis.iter_mut().zip(other).for_each(|(x, other)| *x -= along * other);
            }
        }
        let left = dot(axis, axis).sqrt();
        let by = if left > NOTHING * length { 1.0 / left } else { 0.0 };
        axis.iter_mut().for_each(|x| *x *= by);
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{flat, noise, walk};
    use super::super::lanes::Portable;
    use super::*;

    fn projected(vectors: &[f32], dims: usize) -> (Projected, Centres) {
        let centres = Centres::new(vectors, dims, 1.0);
        (Projected::new(Principal::new(&centres.padded, dims), &centres), centres)
    }

    /// Length in f64 of a difference.
    fn apart(a: impl Iterator<Item = f32>, b: impl Iterator<Item = f32>) -> f64 {
        a.zip(b).map(|(a, b)| (f64::from(a) - f64::from(b)).powi(2)).sum::<f64>().sqrt()
    }

    #[test]
    fn vectors_never_seem_farther_along_the_axes() {
        let mut equal = noise(36, 1).repeat(300);
        equal[36 * 200] += 1e-6;
        for (vectors, dims) in [
            (noise(128 * 300, 1), 128),
            (walk(300, 36, 1).iter().map(|x| x + 100.0).collect(), 36),
            (flat(300, 27, 1), 27),
            (noise(300, 1), 1),
            (vec![0.0; 9 * 300], 9),
            (equal, 36),
        ] {
            let (projected, centres) = projected(&vectors, dims);
            let lanes = dims.div_ceil(WIDTH);
            for (i, a) in (0..300).flat_map(|i| [i + 1, i * 7 + 1, 0].map(|a| (i, a % 300))) {
                let numbers = |c: u32| centres.get(c, lanes).iter().flat_map(|x| x.0);
                let [x, y] = [i, a].map(|c| projected.points[c as usize].0);
                let (seems, is) =
                    (apart(x.into_iter(), y.into_iter()), apart(numbers(i), numbers(a)));
                let slack = projected.slack(&projected.points[i as usize], is as f32);
                assert!(seems <= is * (1.0 + 1e-6) + f64::from(slack));
            }
        }
    }

    #[test]
    fn the_axes_are_those_of_largest_variance() {
        let vectors = flat(3000, 36, 1);
        let (projected, centres) = projected(&vectors, 36);
        for (i, a) in (0..3000).map(|i| (i, (i * 97 + 1500) % 3000)) {
            let numbers = |c: u32| centres.get(c, 5).iter().flat_map(|x| x.0);
            let [x, y] = [i, a].map(|c| projected.points[c as usize].0);
            let (seems, is) = (apart(x.into_iter(), y.into_iter()), apart(numbers(i), numbers(a)));
            // All but the noise in the other axes, at most 0.01 each.
            assert!(seems >= is - 0.06, "{seems} {is}");
        }
        // Of two numbers that differ, the others being constant, both are told in full.
        let two: Vec<f32> = noise(200, 3).chunks(2).flat_map(|x| [5.0, x[0], 7.0, x[1]]).collect();
        let projected = self::projected(&two, 4).0;
        for (a, b) in two.chunks(4).zip(two.chunks(4).skip(1)).zip(0..).map(|((a, b), i)| {
            let [x, y] = [i, i + 1].map(|c: usize| projected.points[c].0.into_iter());
            (apart(a.iter().copied(), b.iter().copied()), apart(x, y))
        }) {
            assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
    }

    #[test]
    fn any_instruction_set_projects_to_the_same_bits() {
        let (projected, centres) = projected(&noise(100 * 27, 1), 27);
        for (x, point) in centres.padded.chunks_exact(4).zip(&projected.points) {
            assert_eq!(projected.axes.project::<Portable>(x), *point);
        }
    }
}
