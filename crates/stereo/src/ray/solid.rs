//! Rays against the shapes of links, and distances from them.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use rover::{LinkId, Posture, Robot, Shape};

/// A shape of a link, where it is.
#[derive(Debug, Clone)]
pub struct Solid {
    /// Its link.
    pub link: LinkId,
    /// Its pose.
    pub world_from_shape: Isometry3<f64>,
    shape: Shape,
    to_local: Matrix3<f64>,
    center: Point3<f64>,
    radius: f64,
}

/// All shapes of a posed robot.
pub(super) fn solids_of(robot: &Robot, posture: &Posture) -> Vec<Solid> {
    let mut solids = Vec::new();
    for (i, link) in robot.links().iter().enumerate() {
        for placed in &link.shapes {
            let pose = posture.link(LinkId(i)) * placed.link_from_shape;
            solids.push(Solid::new(LinkId(i), pose, placed.shape.clone()));
        }
    }
    solids
}

impl Solid {
    fn new(link: LinkId, world_from_shape: Isometry3<f64>, shape: Shape) -> Solid {
        let rotation = world_from_shape.rotation.to_rotation_matrix();
        let to_local = rotation.matrix().transpose();
        let center = world_from_shape.translation.vector.into();
        let radius = shape.bounding_radius();
        Solid { link, world_from_shape, shape, to_local, center, radius }
    }

    /// Middle and radius of a sphere that holds the shape (m).
    pub fn bounds(&self) -> (Point3<f64>, f64) {
        (self.center, self.radius)
    }

    /// Distance and outward normal where a ray of unit direction enters the shape within `reach`.
    /// A ray that starts inside does not enter.
    pub fn hit(
        &self,
        origin: &Point3<f64>,
        direction: &Vector3<f64>,
        reach: f64,
    ) -> Option<(f64, Vector3<f64>)> {
        let to_center = self.center - origin;
        let along = to_center.dot(direction);
        let aside = to_center.norm_squared() - along * along;
        if aside > self.radius * self.radius || along + self.radius < 0.0 {
            return None;
        }
        if along - self.radius > reach {
            return None;
        }
        let o = self.to_local * (origin - self.center);
        let d = self.to_local * direction;
        let (t, normal) = match &self.shape {
            Shape::Box { half_extents } => enter_box(&o, &d, half_extents),
            Shape::Sphere { radius } => enter_sphere(&o, &d, *radius),
            Shape::Cylinder { radius, half_length } => {
                enter_cylinder(&o, &d, *radius, *half_length)
            }
            Shape::Capsule { radius, half_length } => enter_capsule(&o, &d, *radius, *half_length),
            Shape::Mesh(mesh) => enter_mesh(&o, &d, mesh),
        }?;
        (t >= 0.0 && t <= reach).then(|| (t, self.world_from_shape.rotation * normal))
    }

    /// Distance of a point from the shape (m); zero inside. Of a mesh, the distance from its
    /// triangles.
    pub fn distance(&self, point: &Point3<f64>) -> f64 {
        let p = self.to_local * (point - self.center);
        let outside = |excess: [f64; 2]| excess[0].max(0.0).hypot(excess[1].max(0.0));
        match &self.shape {
            Shape::Box { half_extents } => (p.abs() - half_extents).map(|v| v.max(0.0)).norm(),
            Shape::Sphere { radius } => (p.norm() - radius).max(0.0),
            Shape::Cylinder { radius, half_length } => {
                outside([p.xy().norm() - radius, p.z.abs() - half_length])
            }
            Shape::Capsule { radius, half_length } => {
                let along = p.z.clamp(-*half_length, *half_length);
                ((p - Vector3::z() * along).norm() - radius).max(0.0)
            }
            Shape::Mesh(mesh) => {
                let corner = |i: u32| mesh.vertices()[i as usize].coords;
                let triangles = mesh.triangles().iter().map(|t| t.map(corner));
                triangles.map(|t| from_triangle(&p, &t)).fold(f64::INFINITY, f64::min)
            }
        }
    }
}

type Entry = Option<(f64, Vector3<f64>)>;

fn enter_box(o: &Vector3<f64>, d: &Vector3<f64>, half: &Vector3<f64>) -> Entry {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    let mut normal = Vector3::zeros();
    for i in 0..3 {
        if d[i] == 0.0 {
            if o[i].abs() > half[i] {
                return None;
            }
            continue;
        }
        let (near, far) =
            ((-half[i] * d[i].signum() - o[i]) / d[i], (half[i] * d[i].signum() - o[i]) / d[i]);
        if near > enter {
            enter = near;
            normal = Vector3::zeros();
            normal[i] = -d[i].signum();
        }
        leave = leave.min(far);
    }
    (enter <= leave).then_some((enter, normal))
}

fn enter_sphere(o: &Vector3<f64>, d: &Vector3<f64>, radius: f64) -> Entry {
    let along = o.dot(d);
    let root = along * along - o.norm_squared() + radius * radius;
    (root >= 0.0).then(|| {
        let t = -along - root.sqrt();
        (t, (o + d * t) / radius)
    })
}

/// Where the ray enters the endless cylinder about z.
fn enter_tube(o: &Vector3<f64>, d: &Vector3<f64>, radius: f64) -> Entry {
    let a = d.xy().norm_squared();
    let b = o.xy().dot(&d.xy());
    let root = b * b - a * (o.xy().norm_squared() - radius * radius);
    (a > 1e-18 && root >= 0.0).then(|| {
        let t = (-b - root.sqrt()) / a;
        let p = o + d * t;
        (t, Vector3::new(p.x, p.y, 0.0) / radius)
    })
}

fn enter_cylinder(o: &Vector3<f64>, d: &Vector3<f64>, radius: f64, half: f64) -> Entry {
    if let Some((t, normal)) = enter_tube(o, d, radius)
        && (o.z + d.z * t).abs() <= half
        && t >= 0.0
    {
        return Some((t, normal));
    }
    // The cap that faces the ray.
    let side = -d.z.signum();
    let t = (side * half - o.z) / d.z;
    let on_cap = t >= 0.0 && (o + d * t).xy().norm() <= radius;
    on_cap.then_some((t, Vector3::z() * side))
}

fn enter_capsule(o: &Vector3<f64>, d: &Vector3<f64>, radius: f64, half: f64) -> Entry {
    let tube = enter_tube(o, d, radius).filter(|(t, _)| (o.z + d.z * t).abs() <= half);
    let end = |z: f64| enter_sphere(&(o - Vector3::z() * z), d, radius);
    let all = [tube, end(half), end(-half)].into_iter().flatten();
    let ahead = all.filter(|(t, _)| *t >= 0.0);
    ahead.min_by(|a, b| a.0.total_cmp(&b.0))
}

fn enter_mesh(o: &Vector3<f64>, d: &Vector3<f64>, mesh: &rover::Mesh) -> Entry {
    let corner = |i: u32| mesh.vertices()[i as usize].coords;
    let mut best: Entry = None;
    for triangle in mesh.triangles() {
        let [a, b, c] = triangle.map(corner);
        // Möller and Trumbore 1997.
        let (ab, ac) = (b - a, c - a);
        let p = d.cross(&ac);
        let determinant = ab.dot(&p);
        if determinant.abs() < 1e-15 {
            continue;
        }
        let s = o - a;
        let u = s.dot(&p) / determinant;
        let q = s.cross(&ab);
        let v = d.dot(&q) / determinant;
        let t = ac.dot(&q) / determinant;
        let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0;
        if inside && best.is_none_or(|(least, _)| t < least) {
            let normal = ab.cross(&ac).normalize();
            best = Some((t, normal * -normal.dot(d).signum()));
        }
    }
    best
}

/// Distance of a point from a triangle (Ericson 2005, "Real-time collision detection", 5.1.5).
fn from_triangle(p: &Vector3<f64>, [a, b, c]: &[Vector3<f64>; 3]) -> f64 {
    let segment = |a: &Vector3<f64>, b: &Vector3<f64>| {
        let ab = b - a;
        let t = ((p - a).dot(&ab) / ab.norm_squared().max(1e-300)).clamp(0.0, 1.0);
        (p - (a + ab * t)).norm()
    };
    let normal = (b - a).cross(&(c - a));
    let inside = |a: &Vector3<f64>, b: &Vector3<f64>| (b - a).cross(&(p - a)).dot(&normal) >= 0.0;
    if normal.norm_squared() > 0.0 && inside(a, b) && inside(b, c) && inside(c, a) {
        (p - a).dot(&normal).abs() / normal.norm()
    } else {
        segment(a, b).min(segment(b, c)).min(segment(c, a))
    }
}
