//! Where k-means starts: vectors drawn at random, or spread out (k-means++, Arthur and Vassilvitskii 2007).

use super::best::MARGIN;
use super::centres::squared_from_all;
use super::lanes::{Eight, GROUP, Lanes, WIDTH, padded, squared, wide};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;

/// `count` of the `from` at random without replacement, ascending; all if there are not more.
pub fn random(from: &[u32], count: usize, random: &mut Pcg64Mcg) -> Vec<u32> {
    let mut drawn = from.to_vec();
    let count = count.min(drawn.len());
    for i in 0..count {
        let left = (drawn.len() - i) as u64;
        drawn.swap(i, i + (random.next_u64() % left) as usize);
    }
    drawn.truncate(count);
    drawn.sort_unstable();
    drawn
}

/// Up to `count` vectors, each drawn in proportion to its weight times the squared distance from those drawn before, ascending.
/// Fewer come out when all vectors lie, to rounding, on those drawn. `scale` keeps squares within f32.
///
/// Exact, and faster than to compare all vectors with all seeds: a vector can only move to a new seed that is nearer to its old
/// seed than twice the vector is.
pub fn plus_plus(
    vectors: &[f32],
    dims: usize,
    weights: &[f32],
    scale: f32,
    count: usize,
    random: &mut Pcg64Mcg,
) -> Vec<u32> {
    let vectors = Padded { all: padded(vectors, dims, scale), lanes: dims.div_ceil(WIDTH) };
    let mut groups: Vec<Group> = Vec::with_capacity(count);
    // The seeds by eights, the last filled up with what is infinitely far.
    let mut seeds: Vec<Eight> = Vec::with_capacity(count.div_ceil(WIDTH) * dims);
    let mut apart = vec![0.0; count.next_multiple_of(WIDTH)];
    let (mut candidates, mut squares) = (Vec::new(), Vec::new());
    for _ in 0..count {
        let Some(seed) = draw(&groups, weights, random) else { break };
        let mut own = Group::default();
        squared_from_all(vectors.get(seed), dims, &seeds, &mut apart);
        for (group, &apart) in groups.iter_mut().zip(&apart) {
            if apart * (1.0 - MARGIN) > 4.0 * group.reach {
                continue;
            }
            candidates.clear();
            candidates.extend(
                (0..group.members.len())
                    .filter(|&at| apart * (1.0 - MARGIN) <= 4.0 * group.members[at].1)
                    .map(|at| (at, group.members[at].0)),
            );
            squares_of(&vectors, seed, &candidates, &mut squares);
            let before = own.members.len();
            for (&(at, member), &square) in candidates.iter().zip(&squares) {
                if square < group.members[at].1 {
                    own.members.push((member, square));
                    group.members[at].1 = GONE;
                }
            }
            if own.members.len() > before {
                group.members.retain(|member| member.1 != GONE);
                group.measure(weights);
            }
        }
        if groups.is_empty() {
            candidates = (0..weights.len()).map(|i| (i, i as u32)).collect();
            squares_of(&vectors, seed, &candidates, &mut squares);
            own.members = (0..).zip(squares.iter().copied()).collect();
        }
        own.seed = seed;
        let lane = groups.len() % WIDTH;
        if lane == 0 {
            seeds.resize(seeds.len() + dims, Eight([f32::INFINITY; WIDTH]));
        }
        let first = seeds.len() - dims;
        let numbers = vectors.get(seed).iter().flat_map(|eight| eight.0);
        seeds[first..].iter_mut().zip(numbers).for_each(|(seeds, x)| seeds.0[lane] = x);
        own.measure(weights);
        groups.push(own);
    }
    let mut seeds: Vec<u32> = groups.iter().map(|group| group.seed).collect();
    seeds.sort_unstable();
    seeds
}

/// Marks a member that has moved.
const GONE: f32 = -1.0;

/// A seed with the vectors nearest to it.
#[derive(Default)]
struct Group {
    seed: u32,
    /// Vector and squared distance.
    members: Vec<(u32, f32)>,
    /// Largest of the squared distances.
    reach: f32,
    /// Sum of weight times squared distance.
    mass: f64,
}

impl Group {
    fn measure(&mut self, weights: &[f32]) {
        self.reach = self.members.iter().fold(0.0, |reach, member| member.1.max(reach));
        self.mass = self.members.iter().map(|&member| mass(member, weights)).sum();
    }
}

fn mass((vector, square): (u32, f32), weights: &[f32]) -> f64 {
    f64::from(weights[vector as usize]) * f64::from(square)
}

/// A vector in proportion to its mass; the first by weight alone; none if nothing has mass.
fn draw(groups: &[Group], weights: &[f32], random: &mut Pcg64Mcg) -> Option<u32> {
    let part = (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
    let pick = |masses: &mut dyn Iterator<Item = f64>, total: f64| {
        let mut before = 0.0;
        let mut last = None;
        for (at, mass) in masses.enumerate().filter(|&(_, mass)| mass > 0.0) {
            last = Some((at, before));
            if before + mass > part * total {
                break;
            }
            before += mass;
        }
        last
    };
    if groups.is_empty() {
        let total = weights.iter().map(|&w| f64::from(w)).sum();
        return pick(&mut weights.iter().map(|&w| f64::from(w)), total).map(|(at, _)| at as u32);
    }
    let total: f64 = groups.iter().map(|group| group.mass).sum();
    let (group, before) = pick(&mut groups.iter().map(|group| group.mass), total)?;
    let mut left = part * total - before;
    let mut last = None;
    for &member in &groups[group].members {
        let mass = mass(member, weights);
        if mass > 0.0 {
            last = Some(member.0);
            if left < mass {
                break;
            }
        }
        left -= mass;
    }
    last
}

/// Vectors in whole lanes.
struct Padded {
    all: Vec<Eight>,
    lanes: usize,
}

impl Padded {
    #[inline(always)]
    fn get(&self, i: u32) -> &[Eight] {
        &self.all[i as usize * self.lanes..(i as usize + 1) * self.lanes]
    }
}

wide! {
    /// The squared distances of the second of each pair from `seed`.
    fn squares_of(vectors: &Padded, seed: u32, pairs: &[(usize, u32)], squares: &mut Vec<f32>) = all
}

#[inline(always)]
fn all<L: Lanes>(vectors: &Padded, seed: u32, pairs: &[(usize, u32)], squares: &mut Vec<f32>) {
    squares.clear();
    let x = vectors.get(seed);
    for pairs in pairs.chunks(GROUP) {
        let mut four = [x; GROUP];
        for (one, pair) in four.iter_mut().zip(pairs) {
            *one = vectors.get(pair.1);
        }
        squares.extend(&squared::<L>(x, four)[..pairs.len()]);
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::noise;
    use super::*;

    /// k-means++ with every vector compared with every seed.
    fn plain(vectors: &[f32], dims: usize, count: usize, drawn: &[u32]) -> Vec<f64> {
        let vector = |i: usize| &vectors[i * dims..(i + 1) * dims];
        let apart = |a: usize, b: usize| -> f64 {
            vector(a).iter().zip(vector(b)).map(|(x, y)| f64::from(x - y).powi(2)).sum()
        };
        (0..vectors.len() / dims)
            .map(|i| drawn[..count].iter().map(|&s| apart(i, s as usize)).fold(f64::MAX, f64::min))
            .collect()
    }

    #[test]
    fn seeds_spread_more_than_random_ones() {
        // Nine of ten vectors in one spot, the others all over the place.
        let mut vectors = noise(3000 * 5, 1);
        vectors[..2700 * 5].iter_mut().for_each(|x| *x *= 0.01);
        let all: Vec<u32> = (0..3000).collect();
        let cost = |seeds: &[u32]| plain(&vectors, 5, 40, seeds).iter().sum::<f64>();
        let spread = plus_plus(&vectors, 5, &[1.0; 3000], 1.0, 40, &mut Pcg64Mcg::new(3));
        assert_eq!(spread.len(), 40);
        assert!(spread.is_sorted_by(|a, b| a < b));
        assert!(cost(&spread) < 0.7 * cost(&random(&all, 40, &mut Pcg64Mcg::new(3))));
    }

    #[test]
    fn groups_hold_the_nearest_seed() {
        // The mass that the groups report is that of the plain computation: a third vector is drawn where it should be.
        let vectors = noise(500 * 3, 2);
        let mut first_two = [0u32; 500];
        for seed in 0..2000u64 {
            let drawn = plus_plus(
                &vectors,
                3,
                &[1.0; 500],
                1.0,
                1,
                &mut Pcg64Mcg::new(2 * u128::from(seed) + 1),
            );
            first_two[drawn[0] as usize] += 1;
        }
        assert!(first_two.iter().filter(|&&n| n > 0).count() > 480, "the first is uniform");
        let masses = plain(&vectors, 3, 1, &[7]);
        let weights: Vec<f32> = (0..500).map(|i| if i == 7 { 1e30 } else { 1.0 }).collect();
        let mut counts = [0f64; 500];
        for seed in 0..5000u64 {
            let drawn = plus_plus(
                &vectors,
                3,
                &weights,
                1.0,
                2,
                &mut Pcg64Mcg::new(2 * u128::from(seed) + 1),
            );
            counts[drawn.iter().copied().find(|&i| i != 7).unwrap() as usize] += 1.0;
        }
        let total: f64 = masses.iter().sum();
        let chi: f64 = masses
            .iter()
            .zip(counts)
            .filter(|(m, _)| **m > 0.0)
            .map(|(m, n)| (n - 5000.0 * m / total).powi(2) / (5000.0 * m / total))
            .sum();
        assert!((400.0..600.0).contains(&chi), "{chi} for 498 degrees of freedom");
    }

    #[test]
    fn no_vector_is_drawn_twice_and_equal_ones_end_it() {
        let drawn = random(&[4, 5, 6, 7, 8], 5, &mut Pcg64Mcg::new(1));
        assert_eq!(drawn, [4, 5, 6, 7, 8]);
        assert!(random(&[], 3, &mut Pcg64Mcg::new(1)).is_empty());
        let same = plus_plus(&[2.0; 12], 3, &[1.0; 4], 1.0, 3, &mut Pcg64Mcg::new(1));
        assert_eq!(same.len(), 1);
        assert!(plus_plus(&[], 3, &[], 1.0, 3, &mut Pcg64Mcg::new(1)).is_empty());
    }
}
