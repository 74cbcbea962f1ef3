//! A node's matrix as translation, rotation and scale.

use glam::{DMat3, DQuat, DVec3, Vec3};

/// Largest error, relative to the largest number of the matrix, that rounding may leave.
const ROUNDING: f64 = 1e-4;
/// Steps towards the nearest rotation; each gains about a digit.
const STEPS: usize = 64;

/// Translation, rotation (unit quaternion x, y, z, w) and scale, which may be negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Trs {
    pub(super) translation: Vec3,
    pub(super) rotation: [f32; 4],
    pub(super) scale: Vec3,
}

/// The transform of a column-major matrix, and whether it is equal to it. A sheared or perspective
/// matrix has none: it gets the transform whose 3x3 part is nearest in the sum of squares.
pub(super) fn decompose(m: &[f32; 16]) -> (Trs, bool) {
    let column = |c: usize| DVec3::new(m[4 * c].into(), m[4 * c + 1].into(), m[4 * c + 2].into());
    let columns = [column(0), column(1), column(2)];
    let mut axes = frame(columns);
    let exact = error(axes, columns)
        <= ROUNDING * columns.iter().map(|c| c.abs().max_element()).fold(0.0, f64::max);
    if !exact {
        axes = nearest(axes, columns);
    }
    let scale = DVec3::from_array(std::array::from_fn(|i| axes[i].dot(columns[i])));
    let rotation = DQuat::from_mat3(&DMat3::from_cols(axes[0], axes[1], axes[2])).normalize();
    let affine = [m[3], m[7], m[11], m[15]] == [0.0, 0.0, 0.0, 1.0];
    let trs = Trs {
        translation: Vec3::new(m[12], m[13], m[14]),
        rotation: rotation.as_quat().to_array(),
        scale: scale.as_vec3(),
    };
    (trs, exact && affine)
}

/// A right-handed orthonormal frame: the columns made perpendicular, longest first.
fn frame(columns: [DVec3; 3]) -> [DVec3; 3] {
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| columns[*b].length_squared().total_cmp(&columns[*a].length_squared()));
    let [i, j, k] = order;
    let first = columns[i].try_normalize().unwrap_or(DVec3::AXES[i]);
    let across = columns[j] - first * first.dot(columns[j]);
    let second =
        if across.length() > 1e-9 * columns[j].length() { across.try_normalize() } else { None };
    let second = second.unwrap_or_else(|| first.any_orthonormal_vector());
    let third = first.cross(second);
    let mut axes = [DVec3::ZERO; 3];
    axes[i] = first;
    axes[j] = second;
    axes[k] = if (j + 3 - i) % 3 == 1 { third } else { -third };
    axes
}

fn error(axes: [DVec3; 3], columns: [DVec3; 3]) -> f64 {
    let miss = |i: usize| (axes[i] * axes[i].dot(columns[i]) - columns[i]).abs().max_element();
    miss(0).max(miss(1)).max(miss(2))
}

/// Turns the frame, with the best scale at each step, until the sum of squared differences from the
/// columns no longer falls.
fn nearest(mut axes: [DVec3; 3], columns: [DVec3; 3]) -> [DVec3; 3] {
    for _ in 0..STEPS {
        let scale: [f64; 3] = std::array::from_fn(|i| axes[i].dot(columns[i]));
        let torque: DVec3 = (0..3).map(|i| axes[i].cross(columns[i] * scale[i])).sum();
        let inertia: f64 = scale.iter().map(|s| s * s).sum();
        if inertia == 0.0 {
            break;
        }
        let turn = torque / inertia;
        let turn = DQuat::from_xyzw(turn.x / 2.0, turn.y / 2.0, turn.z / 2.0, 1.0).normalize();
        axes = axes.map(|axis| turn * axis);
    }
    axes
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat4, Quat};

    fn compose(trs: &Trs) -> Mat4 {
        Mat4::from_scale_rotation_translation(
            trs.scale,
            Quat::from_array(trs.rotation),
            trs.translation,
        )
    }

    #[test]
    fn exact_matrices_come_back() {
        let scales = [
            Vec3::ONE,
            Vec3::new(1.0, 1.0, -1.0),
            Vec3::new(0.01, 3.0, 200.0),
            Vec3::new(-2.0, 0.0, 1.0),
        ];
        for (k, scale) in scales.into_iter().enumerate() {
            let rotation = Quat::from_xyzw(0.1, -0.5, 0.3 * k as f32, 0.4).normalize();
            let matrix =
                Mat4::from_scale_rotation_translation(scale, rotation, Vec3::new(1.0, 2.0, 3.0));
            let (trs, exact) = decompose(&matrix.to_cols_array());
            assert!(exact, "{scale}");
            assert!(
                compose(&trs).abs_diff_eq(matrix, 2e-6 * scale.max_element()),
                "{scale}: {trs:?}"
            );
        }
    }

    #[test]
    fn a_shear_gets_the_nearest_rotation_and_scale() {
        let shear = Mat4::from_cols_array(&[
            1.0, 0.0, 0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0, 0.2, 2.0, 0.0, 7.0, 8.0, 9.0, 1.0,
        ]);
        let (trs, exact) = decompose(&shear.to_cols_array());
        assert!(!exact);
        let distance =
            |m: Mat4| (0..3).map(|i| (m.col(i) - shear.col(i)).length_squared()).sum::<f32>();
        let best = distance(compose(&trs));
        for (axis, angle) in [(Vec3::X, 0.02), (Vec3::Y, -0.02), (Vec3::Z, 0.02), (Vec3::Z, -0.02)]
        {
            let rotation = Quat::from_axis_angle(axis, angle) * Quat::from_array(trs.rotation);
            assert!(distance(compose(&Trs { rotation: rotation.to_array(), ..trs })) > best);
        }
    }

    #[test]
    fn a_zero_matrix_is_no_rotation_and_no_scale() {
        let mut m = [0.0; 16];
        m[15] = 1.0;
        let (trs, exact) = decompose(&m);
        assert!(
            exact && trs.scale == Vec3::ZERO && trs.rotation == [0.0, 0.0, 0.0, 1.0],
            "{trs:?}"
        );
    }
}
