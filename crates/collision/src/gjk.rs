//! The distance of two convex shapes, as well as the question needs it.
//!
//! Gilbert, Johnson and Keerthi's algorithm (1988) on the Minkowski difference, with both bounds at
//! hand: every support plane bounds the distance from below, every point of the simplex from above. It
//! ends as soon as the shapes are known to be as far apart as asked, or the bounds have met to
//! [`CONVERGED`]. Exact shapes that are curved would need many more rounds to meet to the last digit,
//! which nobody asks for here.

use nalgebra::{Point3, Vector3};

use crate::form::{Form, Placed, nearest_on_triangle};

/// Difference of the bounds at which the distance is known (m).
const CONVERGED: f64 = 1e-7;

/// Rounds after which the bounds are taken as they are: smooth shapes need about ten.
const ROUNDS: usize = 40;

/// Something convex.
pub(crate) trait Convex {
    /// Its farthest point along `n`.
    fn support_point(&self, n: &Vector3<f64>) -> Point3<f64>;
    /// A point inside or on it.
    fn middle(&self) -> Point3<f64>;
}

impl Convex for (&Placed, &Form) {
    fn support_point(&self, n: &Vector3<f64>) -> Point3<f64> {
        self.0.support_point(self.1, n)
    }

    fn middle(&self) -> Point3<f64> {
        self.0.center()
    }
}

impl Convex for [Point3<f64>; 3] {
    fn support_point(&self, n: &Vector3<f64>) -> Point3<f64> {
        let along = self.map(|p| p.coords.dot(n));
        let mut best = usize::from(along[1] > along[0]);
        if along[2] > along[best] {
            best = 2;
        }
        self[best]
    }

    fn middle(&self) -> Point3<f64> {
        Point3::from((self[0].coords + self[1].coords + self[2].coords) / 3.0)
    }
}

/// What is known of a distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Separation {
    /// At least as far as asked.
    Apart,
    /// Not farther than asked: the distance lies between `least` and `most` (m).
    Near {
        /// Bound from below, zero where the shapes overlap.
        least: f64,
        /// Bound from above.
        most: f64,
    },
}

/// The distance of two convex shapes, up to `need` (m).
pub(crate) fn separation(a: &impl Convex, b: &impl Convex, need: f64) -> Separation {
    separation_along(a, b, need, b.middle() - a.middle())
}

/// As [`separation`]; it begins with the direction from `a` to `b` that is given: the better, the sooner
/// it ends.
pub(crate) fn separation_along(
    a: &impl Convex,
    b: &impl Convex,
    need: f64,
    mut toward: Vector3<f64>,
) -> Separation {
    let mut simplex = Simplex::default();
    if toward.norm_squared() < 1e-24 {
        toward = Vector3::x();
    }
    let mut least = 0.0_f64;
    let mut most = f64::INFINITY;
    for _ in 0..ROUNDS {
        // The point of b - a that is nearest to the origin's side.
        let w = b.support_point(&-toward) - a.support_point(&toward);
        let length = toward.norm();
        least = least.max(toward.dot(&w) / length);
        if least >= need {
            return Separation::Apart;
        }
        if most - least <= CONVERGED || simplex.has(&w) {
            break;
        }
        let Some(nearest) = simplex.add(w) else {
            return Separation::Near { least: 0.0, most: 0.0 };
        };
        let distance = nearest.norm();
        if distance <= CONVERGED {
            return Separation::Near { least: 0.0, most: distance };
        }
        if distance >= most {
            break; // rounding: no nearer point is found
        }
        most = distance;
        toward = nearest;
    }
    Separation::Near { least, most: most.max(least) }
}

/// Up to four points of the Minkowski difference.
#[derive(Default)]
struct Simplex {
    points: [Vector3<f64>; 4],
    n: usize,
}

impl Simplex {
    fn has(&self, w: &Vector3<f64>) -> bool {
        self.points[..self.n].iter().any(|p| (p - w).norm_squared() < 1e-26)
    }

    /// Adds a point, keeps the smallest face that holds the point nearest to the origin, and
    /// answers that point; `None` if the origin is inside.
    fn add(&mut self, w: Vector3<f64>) -> Option<Vector3<f64>> {
        self.points[self.n] = w;
        self.n += 1;
        match self.n {
            1 => Some(w),
            2 => Some(self.reduce_segment()),
            3 => Some(self.reduce_triangle([0, 1, 2])),
            _ => self.reduce_tetrahedron(),
        }
    }

    fn keep(&mut self, kept: &[usize]) {
        let points = self.points;
        for (to, &from) in kept.iter().enumerate() {
            self.points[to] = points[from];
        }
        self.n = kept.len();
    }

    fn reduce_segment(&mut self) -> Vector3<f64> {
        let (a, b) = (self.points[0], self.points[1]);
        let ab = b - a;
        let t = -a.dot(&ab) / ab.norm_squared();
        if t.is_nan() || t <= 0.0 {
            self.keep(&[0]);
            a
        } else if t >= 1.0 {
            self.keep(&[1]);
            b
        } else {
            a + ab * t
        }
    }

    fn reduce_triangle(&mut self, corners: [usize; 3]) -> Vector3<f64> {
        let points = corners.map(|i| Point3::from(self.points[i]));
        let (nearest, holds) = nearest_on_triangle(&Point3::origin(), &points);
        let mut kept = [0; 3];
        let mut n = 0;
        for (corner, held) in corners.into_iter().zip(holds) {
            if held {
                kept[n] = corner;
                n += 1;
            }
        }
        self.keep(&kept[..n]);
        nearest.coords
    }

    fn reduce_tetrahedron(&mut self) -> Option<Vector3<f64>> {
        const FACES: [([usize; 3], usize); 4] =
            [([0, 1, 2], 3), ([0, 1, 3], 2), ([0, 2, 3], 1), ([1, 2, 3], 0)];
        let mut best: Option<(f64, [usize; 3])> = None;
        for (face, opposite) in FACES {
            let [a, b, c] = face.map(|i| self.points[i]);
            let normal = (b - a).cross(&(c - a));
            let (inside, origin) = (normal.dot(&(self.points[opposite] - a)), normal.dot(&-a));
            // Flat tetrahedra have their origin outside of every face.
            let flat = inside.abs() <= 1e-14 * normal.norm();
            if flat || inside * origin < 0.0 {
                let points = face.map(|i| Point3::from(self.points[i]));
                let (nearest, _) = nearest_on_triangle(&Point3::origin(), &points);
                let distance = nearest.coords.norm_squared();
                if best.is_none_or(|(least, _)| distance < least) {
                    best = Some((distance, face));
                }
            }
        }
        let (_, face) = best?;
        Some(self.reduce_triangle(face))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, UnitQuaternion};
    use parry3d_f64::query::distance;
    use parry3d_f64::shape::{SharedShape, Triangle};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rover::Frame;

    use super::*;
    use crate::solid::{to_parry_point, to_pose};

    /// How far above the least distance parry may end on curved shapes (m); ours is then the nearer
    /// pair of points.
    const PARRYS: f64 = 3e-5;

    fn random_shape(rng: &mut ChaCha8Rng) -> (Form, SharedShape) {
        let mut size = || rng.random_range(0.02..0.6_f64);
        let (r, half, third) = (size(), size(), size());
        match (r * 1e4) as u64 % 4 {
            0 => (Form::Cylinder { radius: r, half }, SharedShape::cylinder(half, r)),
            1 => (Form::Capsule { radius: r, half }, SharedShape::capsule_y(half, r)),
            2 => (Form::Sphere { radius: r }, SharedShape::ball(r)),
            _ => (
                Form::Box { half: Vector3::new(r, half, third) },
                SharedShape::cuboid(r, half, third),
            ),
        }
    }

    fn random_pose(rng: &mut ChaCha8Rng) -> Isometry3<f64> {
        let mut u = || rng.random_range(-1.0..1.0_f64);
        let turn = UnitQuaternion::from_euler_angles(3.0 * u(), 1.5 * u(), 3.0 * u());
        Isometry3::from_parts(Vector3::new(u(), u(), u()).into(), turn)
    }

    /// Independent oracle: parry's own distance, which runs until rounding.
    #[test]
    fn distances_are_those_of_parry() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let (mut near, mut touching) = (0, 0);
        for _ in 0..20_000 {
            let ((form_a, shape_a), (form_b, shape_b)) =
                (random_shape(&mut rng), random_shape(&mut rng));
            let (pose_a, pose_b) = (random_pose(&mut rng), random_pose(&mut rng));
            let a = Placed::new(Frame::from(&pose_a), &form_a.core());
            let b = Placed::new(Frame::from(&pose_b), &form_b.core());
            let exact = distance(&to_pose(&pose_a), &*shape_a.0, &to_pose(&pose_b), &*shape_b.0)
                .unwrap()
                .distance;
            assert!(
                !crate::form::apart(&a, &form_a, &b, &form_b, exact + 1e-6),
                "called apart by more than {exact}"
            );
            match separation(&(&a, &form_a), &(&b, &form_b), 10.0) {
                Separation::Apart => panic!("nothing is 10 m apart"),
                Separation::Near { least, most } => {
                    assert!(
                        least <= exact + 1e-7 && most >= exact - PARRYS,
                        "{least} {exact} {most}"
                    );
                    assert!(most - least < 1e-6, "{least} to {most}, {form_a:?} {form_b:?}");
                    near += 1;
                    touching += usize::from(exact == 0.0);
                }
            }
            if exact > 2.0 * PARRYS {
                let part = separation(&(&a, &form_a), &(&b, &form_b), exact - 2.0 * PARRYS);
                assert_eq!(part, Separation::Apart, "{exact}");
            }
        }
        assert!(touching > 2_000 && near - touching > 5_000, "{touching} of {near} touch");
    }

    #[test]
    fn distances_from_triangles_are_those_of_parry() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for _ in 0..10_000 {
            let (form, shape) = random_shape(&mut rng);
            let pose = random_pose(&mut rng);
            let placed = Placed::new(Frame::from(&pose), &form.core());
            let size = rng.random_range(0.01..1.0);
            let corner = random_pose(&mut rng).translation.vector;
            let corners = [0, 1, 2]
                .map(|_| Point3::from(corner + random_pose(&mut rng).translation.vector * size));
            let [p, q, r] = corners.map(|c| to_parry_point(&c));
            let triangle = Triangle::new(p, q, r);
            let world = parry3d_f64::math::Pose::IDENTITY;
            let exact = distance(&to_pose(&pose), &*shape.0, &world, &triangle).unwrap().distance;
            let Separation::Near { least, most } = separation(&(&placed, &form), &corners, 10.0)
            else {
                panic!("nothing is 10 m apart")
            };
            assert!(least <= exact + 1e-7 && most >= exact - PARRYS, "{least} {exact} {most}");
            assert!(most - least < 1e-6, "{least} to {most}");
        }
    }
}
