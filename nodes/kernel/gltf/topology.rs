//! Lists, strips and fans of indices, as triangles.

use gltf::json::mesh::Mode;

/// The triangles of a primitive in the order and orientation of section 3.7.2.1 of the glTF 2.0
/// specification, and how many indices are left over; none for points and lines.
pub(super) fn triangles(mode: Mode, indices: &[u32]) -> Option<(Vec<[u32; 3]>, u64)> {
    let n = indices.len();
    let windows = n.saturating_sub(2);
    let list = match mode {
        Mode::Triangles => indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
        Mode::TriangleStrip => {
            let corner = |i: usize| [indices[i], indices[i + 1 + i % 2], indices[i + 2 - i % 2]];
            (0..windows).map(corner).collect()
        }
        Mode::TriangleFan => {
            (0..windows).map(|i| [indices[i + 1], indices[i + 2], indices[0]]).collect()
        }
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => return None,
    };
    let left = if mode == Mode::Triangles {
        n % 3
    } else if windows == 0 {
        n
    } else {
        0
    };
    Some((list, left as u64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_keep_their_orientation() {
        let (strip, left) = triangles(Mode::TriangleStrip, &[5, 6, 7, 8, 9]).unwrap();
        assert_eq!((strip, left), (vec![[5, 6, 7], [6, 8, 7], [7, 8, 9]], 0));
    }

    #[test]
    fn fans_and_lists() {
        assert_eq!(triangles(Mode::TriangleFan, &[5, 6, 7, 8]).unwrap().0, [[6, 7, 5], [7, 8, 5]]);
        assert_eq!(triangles(Mode::Triangles, &[1, 2, 3, 4]).unwrap(), (vec![[1, 2, 3]], 1));
        assert_eq!(triangles(Mode::TriangleFan, &[1, 2]).unwrap(), (vec![], 2));
        assert!(triangles(Mode::Lines, &[1, 2]).is_none());
    }
}
