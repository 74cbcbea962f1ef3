//! A hanging sheet with morph targets.

use super::Mesh;
use glam::{Vec2, Vec3};

/// A displacement along +Z, metres, of the sheet's point at x (0 left, 1 right) and y (0 top, 1 bottom).
pub type Displacement = fn(f32, f32) -> f32;

/// A sheet of `size` metres with `cells` columns and rows that hangs down from the origin in the plane
/// z = 0, facing +Z, displaced by `rest`; `colour` is a function of y. With it, for every one of `modes`,
/// what its morph target adds to positions and normals: any weighted sum has exact normals.
pub fn sheet(
    size: Vec2,
    cells: [usize; 2],
    rest: Displacement,
    modes: &[Displacement],
    colour: impl Fn(f32) -> Vec3,
) -> (Mesh, Vec<Vec<[Vec3; 2]>>) {
    let [columns, rows] = cells.map(|n| n.max(1));
    // Up the slope of a displacement, per metre, by central differences.
    let slope = |f: Displacement, x: f32, y: f32| {
        let h = 1e-3;
        Vec2::new(f(x + h, y) - f(x - h, y), f(x, y - h) - f(x, y + h)) / (size * (2.0 * h))
    };
    let mut mesh = Mesh::default();
    let mut deltas = vec![Vec::new(); modes.len()];
    for i in 0..(columns + 1) * (rows + 1) {
        let (x, y) =
            ((i % (columns + 1)) as f32 / columns as f32, (i / (columns + 1)) as f32 / rows as f32);
        let normal = (-slope(rest, x, y)).extend(1.0);
        mesh.position.push(Vec3::new((x - 0.5) * size.x, -y * size.y, rest(x, y)));
        mesh.normal.push(normal.normalize());
        mesh.colour.push(colour(y));
        for (mode, delta) in modes.iter().zip(&mut deltas) {
            // Slopes add up, so a sum divided by the same length is along the displaced normal.
            let tilt = (-slope(*mode, x, y)).extend(0.0) / normal.length();
            delta.push([Vec3::Z * mode(x, y), tilt]);
        }
    }
    for cell in 0..columns * rows {
        let a = (cell / columns * (columns + 1) + cell % columns) as u32;
        let below = a + columns as u32 + 1;
        mesh.triangle.extend([[a, below, below + 1], [a, below + 1, a + 1]]);
    }
    (mesh, deltas)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn displaced_normals_are_those_of_the_displaced_triangles() {
        let modes: [Displacement; 2] = [|x, y| 0.3 * (5.0 * x + y).sin(), |x, y| 0.2 * x * y];
        let (mesh, deltas) = sheet(
            Vec2::new(1.0, 2.0),
            [60, 90],
            |x, _| 0.1 * (7.0 * x).cos(),
            &modes,
            |_| Vec3::ONE,
        );
        let moved = |k: usize, v: u32| {
            let start = if k == 0 { mesh.position[v as usize] } else { mesh.normal[v as usize] };
            start + deltas[0][v as usize][k] * 0.7 - deltas[1][v as usize][k] * 1.3
        };
        for t in &mesh.triangle {
            let [a, b, c] = t.map(|v| moved(0, v));
            let face = (b - a).cross(c - a).normalize();
            let shading = t.map(|v| moved(1, v).normalize()).iter().sum::<Vec3>().normalize();
            assert!(face.dot(shading) > 0.999, "{face} {shading}");
        }
    }
}
