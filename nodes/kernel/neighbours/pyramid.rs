//! A pyramid of 9-dimensional bounding boxes over an image, and exact branch and bound in it.
//!
//! Neighbouring pixels of an image mostly have neighbouring vectors, so the image's own tiles are a good spatial hierarchy and
//! cost next to nothing to build. Groups of 4x2 pixels are the leaves; inner nodes have eight children, alternately 2x4 and 4x2 of
//! them (8x8, 32x16, 64x64, 256x128 ... pixels), so that eight boxes or eight pixels are measured at once.

use super::candidates::Candidates;
use super::features::{Features, UNMAPPED, Vector, searchable};
use super::lanes::{Bounds, DIMENSIONS, Fan, Leaf, Node, WIDE, near};
use rayon::prelude::*;

/// The pixels of a leaf.
const LEAF: Fan = Fan::Wide;

/// Nodes that wait to be visited at most. Each level has three bits of an image of at most 2^30 pixels, and on the way
/// down all but one of a node's children wait.
const DEEPEST: usize = 11 * WIDE;

/// A node or leaf to visit.
#[derive(Clone, Copy)]
struct Visit {
    /// Not above that of any pixel in it.
    key: u64,
    /// Levels below it: 0 for a leaf.
    level: u32,
    /// Column and row.
    at: [u32; 2],
}

/// All nodes of one size.
pub(super) struct Level {
    /// Nodes in a row.
    columns: u32,
    /// The children of a node.
    pub(super) fan: Fan,
    /// Pixels of a child, in a row and in a column.
    child: [u32; 2],
    nodes: Vec<Node>,
}

/// Exact nearest neighbours among the pixels of one image.
pub struct Pyramid {
    width: u32,
    height: u32,
    /// Leaves in a row.
    columns: u32,
    leaves: Vec<Leaf>,
    /// From the smallest nodes to the single root.
    pub(super) levels: Vec<Level>,
}

impl Pyramid {
    /// The pyramid over an image's vectors; an empty image gives one in which nothing is found.
    pub fn build(features: &Features) -> Self {
        let (width, height) = (features.width(), features.height());
        let mut grid = LEAF.cover([width, height]);
        let columns = grid[0];
        let leaf = |index: u32| {
            Leaf::new(|lane| {
                let [x, y] = LEAF.child(index % columns, index / columns, lane);
                if x < width { features.valid(y * width + x) } else { None }
            })
        };
        let leaves: Vec<Leaf> = (0..columns * grid[1]).into_par_iter().map(leaf).collect();
        let mut boxes: Vec<Bounds> = leaves.par_iter().map(Leaf::bounds).collect();
        let mut levels: Vec<Level> = Vec::new();
        let mut child = LEAF.times([1, 1]);
        // A single leaf has a root, too.
        while boxes.len() > 1 || (boxes.len() == 1 && levels.is_empty()) {
            let fan = if levels.len().is_multiple_of(2) { Fan::Tall } else { Fan::Wide };
            let (nodes, parents) = merge(&boxes, grid, fan);
            grid = fan.cover(grid);
            levels.push(Level { columns: grid[0], fan, child, nodes });
            child = fan.times(child);
            boxes = parents;
        }
        Self { width, height, columns, leaves, levels }
    }

    /// Pixels in a row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The pixel whose vector is nearest to `query` (a weighted 9-vector, as [`Features::vector`] gives), with the squared
    /// distance. None when the image has no valid pixel or the query is not finite or has a component beyond 1e18.
    ///
    /// Among equally near pixels the one nearest in the image to the pixel `home` wins, and among those the one of the smallest
    /// index. `home` is where the query's own pixel lies in this image (clamped into it), so an unchanged image maps to itself
    /// even where all its vectors are equal. `seed` is a guess that makes the search fast and never changes its answer;
    /// [`UNMAPPED`] is no guess.
    pub fn nearest(&self, query: &[f32; 9], home: u32, seed: u32) -> Option<(u32, f32)> {
        if !searchable(query) || self.leaves.is_empty() {
            return None;
        }
        let home = home.min(self.width * self.height - 1);
        self.nearest_within(query, [home % self.width, home / self.width], seed, f32::MAX)
    }

    /// As [`Pyramid::nearest`], at a squared distance of at most `reject`, which is finite and not negative. The query is
    /// searchable and `home`, a column and a row, lies in the image.
    #[inline(always)]
    fn nearest_within(
        &self,
        query: &Vector,
        home: [u32; 2],
        seed: u32,
        reject: f32,
    ) -> Option<(u32, f32)> {
        let guessed = seed < self.width * self.height;
        let guess = if guessed { [seed % self.width, seed / self.width] } else { home };
        let mut search = self.begin(query, home, guess, reject);
        self.finish(None, &mut search);
        search.found()
    }

    /// Begins a search, as [`Pyramid::nearest_within`] takes it, in the leaf of `guess`, a column and a row.
    #[inline(always)]
    pub(super) fn begin(
        &self,
        query: &Vector,
        home: [u32; 2],
        guess: [u32; 2],
        reject: f32,
    ) -> Search {
        let vector = *query;
        // One above a pixel's largest key, so that a pixel at exactly the rejected distance is still found.
        let key = u64::from(reject.to_bits()) << 32 | u64::from(u32::MAX);
        let mut search = Search { vector, home, distance: reject, key, pixel: UNMAPPED };
        // Nothing comes before an exact match at home.
        let [column, row] = LEAF.parent(home);
        if self.leaf(column, row).holds(LEAF.lane(home), &vector) {
            search.offer(0.0, home, home[1] * self.width + home[0]);
            return search;
        }
        let [column, row] = LEAF.parent(guess);
        self.visit_leaf(column, row, &mut search);
        search
    }

    /// Where a pixel lies in this image if it lies to `nearest` as `to` lies to `from`.
    #[inline(always)]
    pub(super) fn beside(&self, (from, nearest): ([usize; 2], u32), to: [usize; 2]) -> [u32; 2] {
        let place = |axis: usize, at: u32, size: u32| {
            let moved = i64::from(at) + to[axis] as i64 - from[axis] as i64;
            moved.clamp(0, i64::from(size) - 1) as u32
        };
        [place(0, nearest % self.width, self.width), place(1, nearest / self.width, self.height)]
    }

    /// Ends a search among `candidates`, which hold what is near enough, or in the whole image.
    #[inline(always)]
    pub(super) fn finish(&self, candidates: Option<&Candidates>, search: &mut Search) {
        // Nothing comes before the pixel at home itself at no distance.
        if search.key == 0 {
            return;
        }
        match (candidates, self.levels.len().checked_sub(1)) {
            (Some(candidates), _) => candidates.visit(self, search),
            (None, Some(root)) => self.visit_all(root, search),
            (None, None) => {}
        }
    }

    /// A node of a level.
    #[inline(always)]
    pub(super) fn node(&self, level: usize, column: u32, row: u32) -> &Node {
        let Level { columns, ref nodes, .. } = self.levels[level];
        &nodes[(row * columns + column) as usize]
    }

    /// Searches the whole image, of every node's children the nearest first.
    #[inline(always)]
    fn visit_all(&self, root: usize, search: &mut Search) {
        let mut stack = [Visit { key: 0, level: root as u32 + 1, at: [0, 0] }; DEEPEST];
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let Visit { key, level, at: [column, row] } = stack[count];
            // A box of an equal key may hold a pixel of an equal key and a smaller index.
            if key > search.key {
                continue;
            }
            let Some(level) = (level as usize).checked_sub(1) else {
                self.visit_leaf(column, row, search);
                continue;
            };
            let Level { fan, child, .. } = self.levels[level];
            let distances = self.node(level, column, row).distances(&search.vector);
            let first = count;
            for lane in near(&distances, search.distance) {
                let [x, y] = fan.child(column, row, lane);
                let key = search.box_key(distances[lane], [x * child[0], y * child[1]], child);
                let mut place = count;
                while place > first && stack[place - 1].key < key {
                    stack[place] = stack[place - 1];
                    place -= 1;
                }
                stack[place] = Visit { key, level: level as u32, at: [x, y] };
                count += 1;
            }
        }
    }

    /// Offers the search the pixels of the leaf in `column` and `row`.
    #[inline(always)]
    pub(super) fn visit_leaf(&self, column: u32, row: u32, search: &mut Search) {
        let distances = self.leaf(column, row).distances(&search.vector);
        for lane in near(&distances, search.distance) {
            let [x, y] = LEAF.child(column, row, lane);
            search.offer(distances[lane], [x, y], y * self.width + x);
        }
    }

    /// The leaf in `column` and `row`.
    #[inline(always)]
    fn leaf(&self, column: u32, row: u32) -> &Leaf {
        &self.leaves[(row * self.columns + column) as usize]
    }
}

/// Makes the nodes of a grid of boxes, and gives the nodes' own boxes, too.
fn merge(boxes: &[Bounds], grid: [u32; 2], fan: Fan) -> (Vec<Node>, Vec<Bounds>) {
    let [columns, rows] = fan.cover(grid);
    let node = |index: u32| {
        let child = |lane| {
            let [x, y] = fan.child(index % columns, index / columns, lane);
            (x < grid[0] && y < grid[1]).then(|| &boxes[(y * grid[0] + x) as usize])
        };
        let bounds = (0..WIDE).filter_map(child).fold(Bounds::EMPTY, |all, one| all.union(one));
        (Node::new(child), bounds)
    };
    (0..columns * rows).into_par_iter().map(node).unzip()
}

/// A search under way: what is sought and the best pixel so far.
pub(super) struct Search {
    pub(super) vector: [f32; DIMENSIONS],
    home: [u32; 2],
    /// The squared distance of the best pixel so far, or the largest that counts.
    pub(super) distance: f32,
    /// The squared distance's bits, then the squared distance in the image: ordered as the pair is.
    key: u64,
    pixel: u32,
}

impl Search {
    /// The best pixel and its squared distance.
    #[inline(always)]
    pub(super) fn found(&self) -> Option<(u32, f32)> {
        (self.pixel != UNMAPPED).then_some((self.pixel, self.distance))
    }

    /// The key of a pixel.
    #[inline(always)]
    fn key(&self, distance: f32, at: [u32; 2]) -> u64 {
        let (x, y) = (at[0].abs_diff(self.home[0]), at[1].abs_diff(self.home[1]));
        u64::from(distance.to_bits()) << 32 | u64::from(x * x + y * y)
    }

    /// A key not above that of any pixel in a rectangle of the image whose box lies `distance` away.
    #[inline(always)]
    fn box_key(&self, distance: f32, corner: [u32; 2], size: [u32; 2]) -> u64 {
        let nearest = std::array::from_fn(|axis| {
            self.home[axis].clamp(corner[axis], corner[axis] + size[axis] - 1)
        });
        self.key(distance, nearest)
    }

    /// Keeps the pixel if it comes before the best so far.
    #[inline(always)]
    fn offer(&mut self, distance: f32, at: [u32; 2], pixel: u32) {
        let key = self.key(distance, at);
        if (key, pixel) < (self.key, self.pixel) {
            (self.key, self.pixel, self.distance) = (key, pixel, distance);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::box_room::{CENTRE, DIAGONAL, Picture, background, constant};
    use super::super::features::squared_distance;
    use super::*;
    use proptest::prelude::*;

    /// A picture of few different points, so that ties abound; every fifth or so is background.
    fn pictures() -> impl Strategy<Value = Picture> {
        (1u32..40, 1u32..30).prop_flat_map(|(width, height)| {
            let count = (width * height) as usize;
            let point = prop::array::uniform3(0u8..3).prop_map(|p| p.map(f32::from));
            let shades = prop::array::uniform3(0u8..2).prop_map(|p| p.map(f32::from));
            let pixels = prop::collection::vec((point, shades, 0u8..5), count);
            pixels.prop_map(move |pixels| Picture {
                width,
                height,
                position: pixels.iter().map(|pixel| pixel.0).collect(),
                normal: vec![[0.0, 1.0, 0.0]; count],
                albedo: pixels.iter().map(|pixel| pixel.1).collect(),
                valid: pixels.iter().map(|pixel| pixel.2).collect(),
            })
        })
    }

    /// The definition: the least of (squared distance, squared distance in the image, index).
    fn by_brute_force(features: &Features, query: &[f32; 9], home: u32) -> Option<(u32, f32)> {
        let width = features.width();
        let candidates = (0..width * features.height()).filter_map(|pixel| {
            let distance = squared_distance(&features.vector(pixel)?, query);
            let (x, y) =
                ((pixel % width).abs_diff(home % width), (pixel / width).abs_diff(home / width));
            Some((distance.to_bits(), x * x + y * y, pixel))
        });
        candidates.min().map(|(bits, _, pixel)| (pixel, f32::from_bits(bits)))
    }

    proptest! {
        #[test]
        fn finds_what_brute_force_finds(
            picture in pictures(),
            queries in prop::collection::vec((prop::array::uniform9(0u8..4), any::<u32>(), any::<u32>()), 20),
        ) {
            let features = picture.features([0.0; 3], 1.0);
            let pyramid = Pyramid::build(&features);
            let count = picture.width * picture.height;
            for (query, home, seed) in queries {
                let query = query.map(|component| f32::from(component) * 0.25);
                let expected = by_brute_force(&features, &query, home % count);
                prop_assert_eq!(pyramid.nearest(&query, home % count, seed % count), expected);
                prop_assert_eq!(pyramid.nearest(&query, home % count, UNMAPPED), expected);
            }
            for pixel in (0..count).filter(|&pixel| features.vector(pixel).is_some()) {
                let query = features.vector(pixel).unwrap_or_default();
                prop_assert_eq!(pyramid.nearest(&query, pixel, UNMAPPED), Some((pixel, 0.0)));
            }
        }
    }

    #[test]
    fn equal_pixels_stay_fast_however_poor_the_seed() {
        // Scanning all ties for each query would take minutes.
        let side = 512;
        let mut picture = constant(side, side);
        picture.valid[..(side * side / 4) as usize].fill(0);
        let features = picture.features(CENTRE, DIAGONAL);
        let pyramid = Pyramid::build(&features);
        let exact = features.vector(side * side - 1).expect("the last pixel is valid");
        let away = exact.map(|component| component + 0.125);
        for home in (0..side * side).step_by(7) {
            let expected =
                if home < side * side / 4 { side * side / 4 + home % side } else { home };
            for query in [exact, away] {
                let found = pyramid.nearest(&query, home, (home * 31) % (side * side));
                assert_eq!(found.map(|(pixel, _)| pixel), Some(expected));
            }
        }
    }

    #[test]
    fn nothing_to_find() {
        let pyramid = Pyramid::build(&background(20, 10).features(CENTRE, DIAGONAL));
        assert_eq!(pyramid.nearest(&[0.0; 9], 3, 4), None);
        let empty = Pyramid::build(&background(0, 0).features(CENTRE, DIAGONAL));
        assert_eq!(empty.nearest(&[0.0; 9], 0, 0), None);
        let pyramid = Pyramid::build(&constant(20, 10).features(CENTRE, DIAGONAL));
        assert_eq!(pyramid.nearest(&[f32::NAN; 9], 3, 4), None);
        assert_eq!(pyramid.nearest(&[f32::MAX; 9], 3, 4), None);
        assert!(pyramid.nearest(&[1e18; 9], u32::MAX, u32::MAX).is_some());
    }
}
