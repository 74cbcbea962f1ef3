//! Node vectors, made from the leaves up and dropped as soon as the parent has them (Buchholz and Boubekeur 2012, section 3.2 and
//! algorithm 1).
//!
//! Each vector is computed from those of its children as they are, never from what was stored of them. A node holds one value, the mean
//! over its children so far, and its children are walked in the order of [`Topology::children`], the one that needs the most values first.
//! So a tree of n leaves needs floor(log2 n) + 1 values at once, and a chain of any length two. (The paper's q + 1 is too few for trees
//! that branch: finished siblings of every ancestor live too.)

use super::harmonics::{cosine, with_functions};
use super::hierarchy::Surfel;
use super::topology::walk::{Fold, fold};
use super::topology::{Part, Topology};
use rayon::prelude::*;
use std::ops::Range;

/// Numbers of a node vector for so many bands: red, green, blue and projected area, each with its coefficients.
pub const fn dimensions(bands: u32) -> usize {
    4 * super::harmonics::functions(bands)
}

crate::choice! {
    /// How children become their parent.
    pub enum Average {
        /// Weighted by area: the vector of a node is the mean over the surface below it.
        Area = "area",
        /// The plain mean of the children, as in the paper: a small child counts as much as a large one.
        Uniform = "uniform",
    }
}

/// An inner node whose vector is complete.
#[derive(Clone, Copy, Debug)]
pub struct Finished<'a> {
    /// Its number.
    pub node: usize,
    /// Area of all surfels below it.
    pub area: f32,
    /// Its vector of [`dimensions`] numbers.
    pub vector: &'a [f32],
}

/// Walks a tree and shows the vector of each inner node to `sink`, children before parents. `leaf` gives the surfel of a leaf. Gives the
/// greatest number of vectors that lived at once, leaves included.
pub fn stream<T: Topology>(
    topology: &T,
    leaf: impl Fn(usize) -> Surfel,
    bands: u32,
    average: Average,
    sink: impl FnMut(Finished),
) -> usize {
    with_functions!(bands, F => {
        let mut vectors = Vectors::<_, _, F> { leaf: &leaf, average, given: &[], sink };
        fold(topology, topology.root(), &mut vectors).1
    })
}

/// The same on many threads: `finish` makes a row of `rows`, which has as many of them as there are inner nodes, out of each vector. Bits
/// do not depend on the number of threads: the tree is cut into subtrees that do not depend on it either, each of which has a state
/// `H` of its own. Gives the greatest number of vectors that can live at once whatever the threads do.
pub fn fill<T: Topology, R: Send, H: Default>(
    topology: &T,
    leaf: impl Fn(usize) -> Surfel + Sync,
    bands: u32,
    average: Average,
    rows: &mut [R],
    finish: impl Fn(&mut H, Finished, &mut [R]) + Sync,
) -> usize {
    let Some(root) = topology.root() else { return 0 };
    with_functions!(bands, F => fill_with::<T, R, H, F>(topology, root, &leaf, average, rows, &finish))
}

/// A vector that lives, and the area below it.
#[derive(Clone, Copy)]
struct Live<const F: usize> {
    vector: [[f32; F]; 4],
    area: f64,
}

impl<const F: usize> Live<F> {
    #[inline(always)]
    fn leaf(surfel: &Surfel) -> Self {
        let lobe = cosine::<F>(surfel.normal);
        let [r, g, b] = surfel.radiance.to_array();
        Live {
            vector: [lobe.map(|c| c * r), lobe.map(|c| c * g), lobe.map(|c| c * b), lobe],
            area: f64::from(surfel.area),
        }
    }

    /// Adds the next of the children to the mean over the `before` children so far.
    #[inline(always)]
    fn merge(&mut self, child: &Self, before: u32, average: Average) {
        let area = self.area + child.area;
        let share = match average {
            Average::Area if area > 0.0 => (child.area / area) as f32,
            _ => 1.0 / (before + 1) as f32,
        };
        for (mean, x) in self.vector.as_flattened_mut().iter_mut().zip(child.vector.as_flattened())
        {
            *mean += (x - *mean) * share;
        }
        self.area = area;
    }

    fn finished(&self, node: usize) -> Finished<'_> {
        Finished { node, area: self.area as f32, vector: self.vector.as_flattened() }
    }
}

/// A walk that makes vectors.
struct Vectors<'a, L, S, const F: usize> {
    leaf: &'a L,
    average: Average,
    /// Vectors that are there, by the number of their node, ascending.
    given: &'a [(usize, Live<F>)],
    sink: S,
}

impl<L: Fn(usize) -> Surfel, S: FnMut(Finished), const F: usize> Fold<Live<F>>
    for Vectors<'_, L, S, F>
{
    #[inline(always)]
    fn leaf(&mut self, leaf: usize) -> Live<F> {
        Live::leaf(&(self.leaf)(leaf))
    }

    #[inline(always)]
    fn merge(&mut self, value: &mut Live<F>, child: &Live<F>, before: u32) {
        value.merge(child, before, self.average);
    }

    fn close(&mut self, node: usize, value: &mut Live<F>) {
        (self.sink)(value.finished(node));
    }

    fn given(&mut self, node: usize) -> Option<Live<F>> {
        let at = self.given.binary_search_by_key(&node, |g| g.0).ok()?;
        Some(self.given[at].1)
    }
}

/// Subtrees that are walked side by side.
const PIECES: usize = 64;
/// Subtrees with fewer inner nodes are not cut further.
const SMALLEST: usize = 4096;

/// A subtree of its own: its root and the number of that, the rows of the nodes below, and the number of the first of them.
struct Piece<'a, N, R> {
    root: N,
    top: usize,
    start: usize,
    rows: &'a mut [R],
}

fn fill_with<T: Topology, R: Send, H: Default, const F: usize>(
    topology: &T,
    root: T::Node,
    leaf: &(impl Fn(usize) -> Surfel + Sync),
    average: Average,
    rows: &mut [R],
    finish: &(impl Fn(&mut H, Finished, &mut [R]) + Sync),
) -> usize {
    let inner = topology.inner();
    let row = rows.len().checked_div(inner).unwrap_or(0);
    let mut pieces = Vec::new();
    let (mut rest, mut passed) = (&mut *rows, 0);
    for (Range { start, end }, top, root) in cut(topology, root) {
        let (_, after) = std::mem::take(&mut rest).split_at_mut((start - passed) * row);
        let (own, after) = after.split_at_mut((end - start) * row);
        pieces.push(Piece { root, top, start, rows: own });
        (rest, passed) = (after, end);
    }
    let mut done: Vec<((usize, Live<F>), usize)> = pieces
        .into_par_iter()
        .filter_map(|piece| {
            let mut state = H::default();
            let sink = |node: Finished| {
                // The row of the root of a piece need not lie among those below it: it is finished with the top of the tree.
                if node.node != piece.top {
                    let at = (node.node - piece.start) * row;
                    finish(&mut state, node, &mut piece.rows[at..at + row]);
                }
            };
            let (value, peak) =
                fold(topology, Some(piece.root), &mut Vectors { leaf, average, given: &[], sink });
            Some(((piece.top, value?), peak))
        })
        .collect();
    done.sort_by_key(|&((top, _), _)| top);
    let together: usize = done.iter().map(|&(_, peak)| peak).sum();
    let given: Vec<(usize, Live<F>)> = done.into_iter().map(|(value, _)| value).collect();
    let mut state = H::default();
    let sink = |node: Finished| {
        let at = node.node * row;
        finish(&mut state, node, &mut rows[at..at + row]);
    };
    let (_, peak) = fold(topology, Some(root), &mut Vectors { leaf, average, given: &given, sink });
    together.max(given.len() + peak)
}

/// Subtrees to be walked side by side: the numbers below, the number of the root, the root; ascending.
fn cut<T: Topology>(topology: &T, root: T::Node) -> Vec<(Range<usize>, usize, T::Node)> {
    let piece = |node| match topology.part(node) {
        Part::Inner(top) => Some((topology.below(node), top, node)),
        Part::Leaf(_) => None,
    };
    let mut pieces: Vec<_> = piece(root).into_iter().collect();
    while pieces.len() < PIECES {
        let Some(largest) = (0..pieces.len()).max_by_key(|&i| pieces[i].0.len()) else { break };
        if pieces[largest].0.len() < SMALLEST {
            break;
        }
        let (_, _, node) = pieces.swap_remove(largest);
        topology.children(node, |child| pieces.extend(piece(child)));
    }
    // An empty range may begin where another one does: it goes first.
    pieces.sort_by_key(|(below, _, _)| (below.start, below.end));
    pieces
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{ball, cloud};
    use super::super::topology::{Built, Octree, binary, octree};
    use super::*;
    use glam::Vec3;

    fn vectors<T: Topology>(
        built: &Built<T>,
        surfels: &[Surfel],
        bands: u32,
        average: Average,
    ) -> (Vec<f32>, usize) {
        let mut rows = vec![f32::NAN; built.topology.inner() * dimensions(bands)];
        let leaf = |k: usize| surfels[built.order[k] as usize];
        let peak = stream(&built.topology, leaf, bands, average, |done| {
            rows[done.node * dimensions(bands)..][..dimensions(bands)].copy_from_slice(done.vector);
        });
        (rows, peak)
    }

    fn parallel<T: Topology>(
        built: &Built<T>,
        surfels: &[Surfel],
        threads: usize,
    ) -> (Vec<f32>, usize) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let mut rows = vec![f32::NAN; built.topology.inner() * dimensions(2)];
        let leaf = |k: usize| surfels[built.order[k] as usize];
        let finish = |_: &mut (), done: Finished, row: &mut [f32]| row.copy_from_slice(done.vector);
        let peak =
            pool.install(|| fill(&built.topology, leaf, 2, Average::Area, &mut rows, finish));
        (rows, peak)
    }

    /// The vector of all surfels by its definition, in f64.
    fn direct(surfels: &[Surfel], bands: u32) -> Vec<f64> {
        let total: f64 = surfels.iter().map(|s| f64::from(s.area)).sum();
        let mut sum = vec![0.0; dimensions(bands)];
        for s in surfels {
            let lobe = with_functions!(bands, F => cosine::<F>(s.normal).to_vec());
            for (channel, scale) in s.radiance.to_array().into_iter().chain([1.0]).enumerate() {
                for (i, c) in lobe.iter().enumerate() {
                    sum[channel * lobe.len() + i] +=
                        f64::from(s.area) * f64::from(scale) * f64::from(*c) / total;
                }
            }
        }
        sum
    }

    #[test]
    fn root_is_the_mean_over_the_surface() {
        let surfels = cloud(3000, 5.0, 11);
        for bands in 1..=5 {
            let expected = direct(&surfels, bands);
            let (binary, octree) = (binary::build(&surfels), octree::build(&surfels));
            let Some(Part::Inner(root)) = binary.topology.root().map(|r| binary.topology.part(r))
            else {
                panic!()
            };
            let of_binary = vectors(&binary, &surfels, bands, Average::Area)
                .0
                .split_off(root * dimensions(bands));
            let of_octree = vectors(&octree, &surfels, bands, Average::Area).0;
            for (i, e) in expected.iter().enumerate() {
                for got in [of_binary[i], of_octree[i]] {
                    assert!((f64::from(got) - e).abs() < 1e-6, "{bands} {i}: {got} {e}");
                }
            }
        }
    }

    #[test]
    fn averages_differ_as_they_should() {
        // A dark large surfel beside a bright small one.
        let surfel = |x, radiance, area| Surfel {
            position: Vec3::X * x,
            normal: Vec3::Y,
            radiance: Vec3::splat(radiance),
            area,
            radius: 0.1,
        };
        let surfels = vec![surfel(0.0, 0.0, 3.0), surfel(1.0, 8.0, 1.0)];
        let built = binary::build(&surfels);
        let (by_area, _) = vectors(&built, &surfels, 1, Average::Area);
        let (uniform, _) = vectors(&built, &surfels, 1, Average::Uniform);
        assert_eq!((by_area[0] / by_area[3], uniform[0] / uniform[3]), (2.0, 4.0));
        // Nothing but zero areas: a plain mean, and no division by zero.
        let flat: Vec<_> = surfels.iter().map(|s| Surfel { area: 0.0, ..*s }).collect();
        assert_eq!(vectors(&built, &flat, 1, Average::Area).0, uniform);
    }

    #[test]
    fn threads_and_order_of_pieces_change_nothing() {
        let surfels = ball(30_000, 8);
        let (binary, octree) = (binary::build(&surfels), octree::build(&surfels));
        let (one, bound) = parallel(&binary, &surfels, 1);
        assert!(one == vectors(&binary, &surfels, 2, Average::Area).0);
        assert_eq!(parallel(&binary, &surfels, 3), (one, bound));
        let (one, bound) = parallel(&octree, &surfels, 1);
        assert!(one == vectors(&octree, &surfels, 2, Average::Area).0);
        assert_eq!(parallel(&octree, &surfels, 3), (one, bound));
    }

    #[test]
    fn small_trees() {
        for count in 0..3 {
            let surfels = vec![cloud(1, 1.0, 1)[0]; count];
            let (rows, peak) = vectors(&binary::build(&surfels), &surfels, 2, Average::Area);
            assert_eq!((rows.len(), peak), (count.saturating_sub(1) * 16, count));
            assert_eq!(
                vectors(&octree::build(&surfels), &surfels, 2, Average::Area),
                (rows.clone(), peak)
            );
            assert_eq!(parallel(&octree::build(&surfels), &surfels, 2).0, rows);
        }
    }

    /// A full octree of this depth.
    fn perfect(depth: u32) -> Octree<'static> {
        let (mut first, mut counts) = (Vec::new(), Vec::new());
        let inner: u32 = (0..depth).map(|d| 8u32.pow(d)).sum();
        let parents: u32 = (0..depth - 1).map(|d| 8u32.pow(d)).sum();
        for i in 0..inner {
            first.push(if i < parents { [8 * i + 1, 0] } else { [inner, 8 * (i - parents)] });
            counts.push(if i < parents { 8 } else { 8 << 4 });
        }
        Octree { first: first.into(), counts: counts.into(), leaves: 8u32.pow(depth) }
    }

    /// Each node with one leaf and one inner child, down to two leaves.
    fn chain(leaves: u32) -> Octree<'static> {
        let first = (0..leaves - 1).map(|i| [i + 1, i]).collect::<Vec<_>>();
        let mut counts = vec![1 | 1 << 4; leaves as usize - 1];
        counts[leaves as usize - 2] = 2 << 4;
        Octree { first: first.into(), counts: counts.into(), leaves }
    }

    #[test]
    fn few_vectors_live_at_once() {
        let surfel = cloud(1, 1.0, 3)[0];
        let peak = |t: &Octree| stream(t, |_| surfel, 1, Average::Area, |_| ());
        let of_binary =
            |leaves| stream(&binary::Binary { leaves }, |_| surfel, 1, Average::Area, |_| ());
        // Depth 16 and two children: 18 when finished siblings all live; depth 6 and eight: 44.
        assert_eq!(of_binary(1 << 16), 17);
        assert_eq!(peak(&perfect(6)), 7);
        assert_eq!(peak(&chain(100_000)), 2);
        for leaves in [2, 3, 7, 8, 1000, 99_999] {
            assert_eq!(of_binary(leaves), leaves.ilog2() as usize + 1);
        }
        let surfels = cloud(20_000, 1.0, 5);
        let built = octree::build(&surfels);
        assert!(vectors(&built, &surfels, 1, Average::Area).1 <= 11);
    }

    #[test]
    fn long_chain_keeps_the_mean() {
        let surfels = cloud(100_000, 1.0, 9);
        let tree = chain(100_000);
        let mut root = Vec::new();
        stream(
            &tree,
            |k| surfels[k],
            3,
            Average::Area,
            |done| {
                if done.node == 0 {
                    root = done.vector.to_vec();
                }
            },
        );
        for (got, expected) in root.iter().zip(direct(&surfels, 3)) {
            assert!((f64::from(*got) - expected).abs() < 1e-4, "{got} {expected}");
        }
    }
}
