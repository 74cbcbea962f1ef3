//! Eight vectors or eight boxes at a time, as structures of arrays the compiler turns into vector instructions.

use super::features::Vector;

/// Children of a node, and pixels of a leaf.
pub(super) const WIDE: usize = 8;

/// Components of a vector.
pub(super) const DIMENSIONS: usize = 9;

/// One component for each of eight pixels or boxes.
pub(super) type Lanes = [f32; WIDE];

/// How eight pixels or children lie in a rectangle, row by row.
#[derive(Clone, Copy)]
pub(super) enum Fan {
    /// Four in a row, two rows.
    Wide,
    /// Two in a row, four rows.
    Tall,
}

impl Fan {
    /// Base-two logarithms of the number in a row and of the number of rows: shifts, because a division costs as much as a box.
    #[inline(always)]
    fn shifts(self) -> [u32; 2] {
        match self {
            Self::Wide => [2, 1],
            Self::Tall => [1, 2],
        }
    }

    /// The column and row of one of the eight that belong to the node in `column` and `row`.
    #[inline(always)]
    pub(super) fn child(self, column: u32, row: u32, lane: usize) -> [u32; 2] {
        let [wide, tall] = self.shifts();
        let (x, y) = (lane as u32 & ((1 << wide) - 1), lane as u32 >> wide);
        [(column << wide) + x, (row << tall) + y]
    }

    /// The column and row of the node to which the one in `x` and `y` belongs.
    #[inline(always)]
    pub(super) fn parent(self, [x, y]: [u32; 2]) -> [u32; 2] {
        let [wide, tall] = self.shifts();
        [x >> wide, y >> tall]
    }

    /// The lane of the one in `x` and `y` among the eight of its node.
    #[inline(always)]
    pub(super) fn lane(self, [x, y]: [u32; 2]) -> usize {
        let [wide, tall] = self.shifts();
        ((x & ((1 << wide) - 1)) + ((y & ((1 << tall) - 1)) << wide)) as usize
    }

    /// The size of a rectangle of eight of `size`.
    pub(super) fn times(self, size: [u32; 2]) -> [u32; 2] {
        let [wide, tall] = self.shifts();
        [size[0] << wide, size[1] << tall]
    }

    /// The size of the grid of nodes that covers a grid of `size`.
    pub(super) fn cover(self, size: [u32; 2]) -> [u32; 2] {
        let [wide, tall] = self.shifts();
        [size[0].div_ceil(1 << wide), size[1].div_ceil(1 << tall)]
    }
}

/// An axis-aligned box in nine dimensions.
#[derive(Clone, Copy)]
pub(super) struct Bounds {
    pub(super) low: [f32; DIMENSIONS],
    pub(super) high: [f32; DIMENSIONS],
}

impl Bounds {
    /// The box without points, which is infinitely far from everything.
    pub(super) const EMPTY: Self =
        Self { low: [f32::INFINITY; DIMENSIONS], high: [f32::NEG_INFINITY; DIMENSIONS] };

    /// The smallest box around both.
    pub(super) fn union(&self, other: &Self) -> Self {
        Self {
            low: std::array::from_fn(|component| {
                smaller(self.low[component], other.low[component])
            }),
            high: std::array::from_fn(|component| {
                larger(self.high[component], other.high[component])
            }),
        }
    }
}

/// The vectors of eight pixels; an invalid one is infinite in the first component.
pub(super) struct Leaf([Lanes; DIMENSIONS]);

impl Leaf {
    /// Gathers eight vectors; those that are missing are invalid.
    pub(super) fn new<'a>(vector: impl Fn(usize) -> Option<&'a Vector>) -> Self {
        let vectors: [Option<&Vector>; WIDE] = std::array::from_fn(vector);
        Self(std::array::from_fn(|component| {
            vectors.map(|vector| vector.map_or(f32::INFINITY, |vector| vector[component]))
        }))
    }

    /// The squared distances of the eight pixels; infinite for the invalid.
    #[inline(always)]
    pub(super) fn distances(&self, query: &[f32; DIMENSIONS]) -> Lanes {
        sum_of_squares(|component| self.0[component].map(|value| query[component] - value))
    }

    /// Whether one of the pixels has exactly this vector.
    #[inline(always)]
    pub(super) fn holds(&self, lane: usize, query: &[f32; DIMENSIONS]) -> bool {
        (0..DIMENSIONS).all(|component| self.0[component][lane] == query[component])
    }

    /// The valid pixels' bounding box.
    pub(super) fn bounds(&self) -> Bounds {
        (0..WIDE).filter(|&lane| self.0[0][lane].is_finite()).fold(Bounds::EMPTY, |bounds, lane| {
            let point = self.0.map(|component| component[lane]);
            bounds.union(&Bounds { low: point, high: point })
        })
    }
}

/// The bounding boxes of eight children.
pub(super) struct Node {
    low: [Lanes; DIMENSIONS],
    high: [Lanes; DIMENSIONS],
}

impl Node {
    /// Gathers eight boxes; those that are missing are empty.
    pub(super) fn new<'a>(bounds: impl Fn(usize) -> Option<&'a Bounds>) -> Self {
        let children: [Bounds; WIDE] =
            std::array::from_fn(|lane| bounds(lane).copied().unwrap_or(Bounds::EMPTY));
        Self {
            low: std::array::from_fn(|component| children.map(|child| child.low[component])),
            high: std::array::from_fn(|component| children.map(|child| child.high[component])),
        }
    }

    /// The squared distances of the eight boxes: zero inside, infinite for an empty one.
    #[inline(always)]
    pub(super) fn distances(&self, query: &[f32; DIMENSIONS]) -> Lanes {
        self.apart(query, query)
    }

    /// The squared distances of the eight boxes from another; never more than that of any point in it.
    #[inline(always)]
    pub(super) fn distances_to(&self, other: &Bounds) -> Lanes {
        self.apart(&other.low, &other.high)
    }

    #[inline(always)]
    fn apart(&self, from: &[f32; DIMENSIONS], to: &[f32; DIMENSIONS]) -> Lanes {
        sum_of_squares(|component| {
            let (low, high) = (&self.low[component], &self.high[component]);
            let mut outside = [0.0; WIDE];
            for lane in 0..WIDE {
                let (below, above) = (low[lane] - to[component], from[component] - high[lane]);
                outside[lane] = larger(larger(below, above), 0.0);
            }
            outside
        })
    }

    /// The box of one child.
    pub(super) fn child(&self, lane: usize) -> Bounds {
        let of = |sides: &[Lanes; DIMENSIONS]| std::array::from_fn(|k| sides[k][lane]);
        Bounds { low: of(&self.low), high: of(&self.high) }
    }
}

/// Adds the squares of nine differences, lane by lane, in the order that defines the squared distance. Rounding is monotonic, so
/// with differences to a box this never exceeds, by even one bit, the distance to a pixel in the box.
#[inline(always)]
fn sum_of_squares(difference: impl Fn(usize) -> Lanes) -> Lanes {
    let mut sums = [[0.0; WIDE]; 4];
    for component in 0..DIMENSIONS {
        let difference = difference(component);
        let sum = &mut sums[component % 4];
        for lane in 0..WIDE {
            sum[lane] += difference[lane] * difference[lane];
        }
    }
    let mut total = [0.0; WIDE];
    for lane in 0..WIDE {
        total[lane] = (sums[0][lane] + sums[1][lane]) + (sums[2][lane] + sums[3][lane]);
    }
    total
}

/// The lanes whose distance is not above the bound. Mostly there are one or two, so the eight comparisons become one mask.
#[inline(always)]
pub(super) fn near(distances: &Lanes, bound: f32) -> impl Iterator<Item = usize> + use<> {
    let mut mask = 0u32;
    for (lane, &distance) in distances.iter().enumerate() {
        mask |= u32::from(distance <= bound) << lane;
    }
    std::iter::from_fn(move || {
        let lane = mask.trailing_zeros() as usize;
        mask &= mask.wrapping_sub(1);
        (lane < WIDE).then_some(lane)
    })
}

/// The larger of two numbers that are not NaN; unlike `f32::max` a single instruction.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The smaller of two numbers that are not NaN.
#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::super::features::squared_distance;
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = [f32; DIMENSIONS]> {
        prop::array::uniform9(-2.0f32..2.0)
    }

    proptest! {
        #[test]
        fn lanes_have_the_bits_of_the_single_distance(vectors in prop::array::uniform8(vector()), query in vector()) {
            let distances = Leaf::new(|lane| vectors.get(lane)).distances(&query);
            for (lane, distance) in distances.iter().enumerate() {
                prop_assert_eq!(distance.to_bits(), squared_distance(&vectors[lane], &query).to_bits());
            }
        }

        #[test]
        fn a_box_is_never_farther_than_what_it_holds(vectors in prop::array::uniform8(vector()), query in vector()) {
            let leaf = Leaf::new(|lane| vectors.get(lane));
            let bounds = leaf.bounds();
            let to_box = Node::new(|lane| (lane == 3).then_some(&bounds)).distances(&query);
            prop_assert!(leaf.distances(&query).iter().all(|distance| *distance >= to_box[3]));
            prop_assert_eq!(to_box[0], f32::INFINITY);
            let inside = std::array::from_fn(|component| vectors[5][component]);
            prop_assert_eq!(Node::new(|_| Some(&bounds)).distances(&inside), [0.0; WIDE]);
        }
    }

    #[test]
    fn invalid_pixels_are_infinitely_far_and_bound_nothing() {
        let some = [0.5; DIMENSIONS];
        let leaf = Leaf::new(|lane| (lane == 6).then_some(&some));
        let distances = leaf.distances(&[0.5; DIMENSIONS]);
        assert_eq!(distances[6], 0.0);
        assert_eq!(near(&distances, f32::MAX).collect::<Vec<_>>(), [6]);
        assert_eq!(leaf.bounds().high, [0.5; DIMENSIONS]);
    }

    #[test]
    fn children_and_parents_agree() {
        for fan in [Fan::Wide, Fan::Tall] {
            for lane in 0..WIDE {
                let at = fan.child(3, 5, lane);
                assert_eq!((fan.parent(at), fan.lane(at)), ([3, 5], lane));
            }
        }
        assert_eq!(Fan::Tall.times(Fan::Wide.times([1, 1])), [8, 8]);
        assert_eq!(Fan::Wide.cover([640, 481]), [160, 241]);
    }
}
