//! Shapes for the quick tests: support functions, cores, and bounds on distance from below.
//!
//! Each shape is held by its *core* grown by a radius: a segment for round shapes. Two shapes are at
//! least as far apart as any direction separates them, by their support functions; the direction
//! between their cores is nearly always the right one. What this leaves open, parry decides.

use std::sync::Arc;

use geometry::Block;
use nalgebra::{Point3, Vector3};
use rover::Frame;

/// A convex shape about its own origin; cylinders and capsules stand along y.
#[derive(Debug, Clone)]
pub(crate) enum Form {
    Box { half: Vector3<f64> },
    Cylinder { radius: f64, half: f64 },
    Capsule { radius: f64, half: f64 },
    Sphere { radius: f64 },
    Hull { points: Arc<Vec<Point3<f64>>> },
}

/// What holds a shape: all of it lies within `radius` of the segment from `-half` to `half`.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Core {
    pub half: Vector3<f64>,
    pub radius: f64,
}

/// A shape somewhere.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placed {
    /// From the shape to `world`.
    pub frame: Frame,
    /// Half of the core's segment in `world` (m).
    pub half: Vector3<f64>,
    /// Radius about the core (m).
    pub radius: f64,
    /// Radius of the sphere about the origin that holds the shape (m).
    pub bound: f64,
}

impl Form {
    /// Farthest extent of the shape along `n` from its origin (m); `n` in the shape's frame.
    fn support(&self, n: &Vector3<f64>) -> f64 {
        match self {
            Form::Box { half } => half.dot(&n.abs()),
            Form::Cylinder { radius, half } => {
                half * n.y.abs() + radius * (n.x * n.x + n.z * n.z).sqrt()
            }
            Form::Capsule { radius, half } => half * n.y.abs() + radius * n.norm(),
            Form::Sphere { radius } => radius * n.norm(),
            Form::Hull { points } => {
                points.iter().map(|p| p.coords.dot(n)).fold(f64::NEG_INFINITY, f64::max)
            }
        }
    }

    /// The farthest point along `n`; both in the shape's frame.
    fn support_point(&self, n: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Form::Box { half } => half.zip_map(n, f64::copysign),
            Form::Cylinder { radius, half } => {
                let across = (n.x * n.x + n.z * n.z).sqrt();
                let r = if across > 1e-12 { radius / across } else { 0.0 };
                Vector3::new(n.x * r, half.copysign(n.y), n.z * r)
            }
            Form::Capsule { radius, half } => {
                unit_or_zero(n) * *radius + Vector3::y() * half.copysign(n.y)
            }
            Form::Sphere { radius } => unit_or_zero(n) * *radius,
            Form::Hull { points } => {
                let along = |p: &Point3<f64>| p.coords.dot(n);
                let far = points.iter().max_by(|a, b| along(a).total_cmp(&along(b)));
                far.map_or_else(Vector3::zeros, |p| p.coords)
            }
        }
    }

    /// Is a point (in the shape's frame) surely in the shape? `false` is no answer for hulls.
    fn holds(&self, p: &Vector3<f64>) -> bool {
        match self {
            Form::Box { half } => p.abs() <= *half,
            Form::Cylinder { radius, half } => {
                p.y.abs() <= *half && p.x * p.x + p.z * p.z <= radius * radius
            }
            Form::Capsule { radius, half } => {
                let beyond = (p.y.abs() - half).max(0.0);
                beyond * beyond + p.x * p.x + p.z * p.z <= radius * radius
            }
            Form::Sphere { radius } => p.norm_squared() <= radius * radius,
            Form::Hull { .. } => false,
        }
    }

    /// The core: along the longest axis, so that what holds the shape is small.
    pub fn core(&self) -> Core {
        match self {
            Form::Box { half } => Core::of_box(half),
            // A flat cylinder is held better by a sphere than by a capsule.
            Form::Cylinder { radius, half } if half < radius => {
                Core { half: Vector3::zeros(), radius: radius.hypot(*half) }
            }
            Form::Cylinder { radius, half } | Form::Capsule { radius, half } => {
                Core { half: Vector3::y() * *half, radius: *radius }
            }
            Form::Sphere { radius } => Core { half: Vector3::zeros(), radius: *radius },
            Form::Hull { points } => {
                let extent = points
                    .iter()
                    .fold(Vector3::zeros(), |most: Vector3<f64>, p| most.sup(&p.coords.abs()));
                let mut core = Core::of_box(&extent);
                let far = |p: &Point3<f64>| {
                    let along = unit_or_zero(&core.half);
                    let t = p.coords.dot(&along).clamp(-core.half.norm(), core.half.norm());
                    (p.coords - along * t).norm()
                };
                core.radius = points.iter().map(far).fold(0.0, f64::max);
                core
            }
        }
    }
}

fn unit_or_zero(v: &Vector3<f64>) -> Vector3<f64> {
    v.try_normalize(1e-12).unwrap_or_default()
}

impl Core {
    fn of_box(half: &Vector3<f64>) -> Core {
        let long = half.imax();
        let mut segment = Vector3::zeros();
        segment[long] = half[long];
        Core { half: segment, radius: (half - segment).norm() }
    }
}

impl Placed {
    pub fn new(frame: Frame, core: &Core) -> Placed {
        let half = frame.rotation * core.half;
        Placed { frame, half, radius: core.radius, bound: core.half.norm() + core.radius }
    }

    /// The same, moved by `z` (m) along world's z.
    pub fn raised(&self, z: f64) -> Placed {
        let mut moved = *self;
        moved.frame.origin.z += z;
        moved
    }

    pub fn center(&self) -> Point3<f64> {
        Point3::from(self.frame.origin)
    }

    /// Both ends of the core's segment.
    pub fn ends(&self) -> [Point3<f64>; 2] {
        [self.center() - self.half, self.center() + self.half]
    }

    /// The farthest point along `n`, in `world`.
    pub fn support_point(&self, form: &Form, n: &Vector3<f64>) -> Point3<f64> {
        self.frame.point(&Point3::from(form.support_point(&self.frame.rotation.tr_mul(n))))
    }

    /// Is a point of `world` surely in the shape?
    pub fn holds(&self, form: &Form, p: &Point3<f64>) -> bool {
        form.holds(&self.frame.rotation.tr_mul(&(p - self.center())))
    }

    /// Farthest extent along `n` (a unit vector of `world`) from the origin (m).
    fn support(&self, form: &Form, n: &Vector3<f64>) -> f64 {
        form.support(&self.frame.rotation.tr_mul(n))
    }

    /// Lowest and highest corner of the axis-parallel box around the shape.
    pub fn aabb(&self, form: &Form) -> (Point3<f64>, Point3<f64>) {
        let reach = |sign: f64| {
            Vector3::from_fn(|i, _| {
                let row = self.frame.rotation.row(i).transpose() * sign;
                form.support(&row)
            })
        };
        let up = reach(1.0);
        // All forms but hulls are their own mirror images.
        let down = if matches!(form, Form::Hull { .. }) { reach(-1.0) } else { up };
        (self.center() - down, self.center() + up)
    }
}

/// Are two shapes at least `need` (m) apart? `false` is no answer.
pub(crate) fn apart(a: &Placed, form_a: &Form, b: &Placed, form_b: &Form, need: f64) -> bool {
    toward(a, form_a, b, form_b, need).is_none()
}

/// The direction from one shape to the other, about, unless they are surely at least `need` (m) apart.
pub(crate) fn toward(
    a: &Placed,
    form_a: &Form,
    b: &Placed,
    form_b: &Form,
    need: f64,
) -> Option<Vector3<f64>> {
    let between = b.frame.origin - a.frame.origin;
    let reach = a.bound + b.bound + need;
    if between.norm_squared() >= reach * reach {
        return None;
    }
    let (p, q) = match (form_a, form_b) {
        (_, Form::Box { half }) => {
            if outside_box(&a.center(), b, half, a.bound + need) {
                return None;
            }
            segment_to_box(a, b, half)
        }
        (Form::Box { half }, _) => {
            if outside_box(&b.center(), a, half, b.bound + need) {
                return None;
            }
            let (q, p) = segment_to_box(b, a, half);
            (p, q)
        }
        _ => segment_to_segment(a, b),
    };
    // Cores that cross tell no direction.
    let Some(n) = (q - p).try_normalize(1e-9) else { return Some(between) };
    let apart = n.dot(&between) - a.support(form_a, &n) - b.support(form_b, &-n) >= need;
    (!apart).then_some(n)
}

/// A distance (m) that two shapes are at least apart, quickly: where it is beyond `enough`, by spheres
/// alone. Negative where nothing is known.
pub(crate) fn apart_by(a: &Placed, form_a: &Form, b: &Placed, form_b: &Form, enough: f64) -> f64 {
    let between = b.frame.origin - a.frame.origin;
    let by_spheres = between.norm() - a.bound - b.bound;
    if by_spheres >= enough {
        return by_spheres;
    }
    let (p, q) = match (form_a, form_b) {
        (_, Form::Box { half }) => segment_to_box(a, b, half),
        (Form::Box { half }, _) => {
            let (q, p) = segment_to_box(b, a, half);
            (p, q)
        }
        _ => segment_to_segment(a, b),
    };
    let Some(n) = (q - p).try_normalize(1e-9) else { return by_spheres };
    by_spheres.max(n.dot(&between) - a.support(form_a, &n) - b.support(form_b, &-n))
}

/// Is a point at least `distance` (m) away from a box?
fn outside_box(p: &Point3<f64>, at: &Placed, half: &Vector3<f64>, distance: f64) -> bool {
    let local = at.frame.rotation.tr_mul(&(p - at.center()));
    let beyond = (local.abs() - half).sup(&Vector3::zeros());
    beyond.norm_squared() >= distance * distance
}

/// Is a shape at least `need` (m) away from the column of ground below a block of squares?
pub(crate) fn apart_from_block(
    shape: &Placed,
    form: &Form,
    (lo, hi): &(Point3<f64>, Point3<f64>),
    block: &Block,
    need: f64,
) -> bool {
    let gap = Vector3::new(
        (block.min.x - hi.x).max(lo.x - block.max.x).max(0.0),
        (block.min.y - hi.y).max(lo.y - block.max.y).max(0.0),
        (lo.z - block.top).max(0.0),
    );
    if gap.norm_squared() >= need * need {
        return true;
    }
    if shape.half.norm_squared() == 0.0 {
        // A round shape's box is nearly as good as its core.
        let c = shape.center();
        let q = Point3::new(
            c.x.clamp(block.min.x, block.max.x),
            c.y.clamp(block.min.y, block.max.y),
            c.z.min(block.top),
        );
        return separates_block(shape, form, &(q - c), block, need);
    }
    let nearest = |p: &Point3<f64>| {
        Point3::new(
            p.x.clamp(block.min.x, block.max.x),
            p.y.clamp(block.min.y, block.max.y),
            p.z.min(block.top),
        )
    };
    let p = nearest_on_segment(shape, nearest);
    separates_block(shape, form, &(nearest(&p) - p), block, need)
}

fn separates_block(
    shape: &Placed,
    form: &Form,
    toward: &Vector3<f64>,
    block: &Block,
    need: f64,
) -> bool {
    let Some(n) = toward.try_normalize(1e-9) else { return false };
    if n.z > 0.0 {
        return false; // the column has no lower end
    }
    let least = (n.x * block.min.x).min(n.x * block.max.x)
        + (n.y * block.min.y).min(n.y * block.max.y)
        + n.z * block.top;
    least - n.dot(&shape.frame.origin) - shape.support(form, &n) >= need
}

/// What a quick look says of a shape and a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum QuickLook {
    /// As far apart as asked.
    Apart,
    /// This point of the triangle is in the shape.
    Touching(Point3<f64>),
    /// Neither is certain.
    Unclear,
}

/// Is a shape at least `need` (m) away from a triangle?
pub(crate) fn look_at_triangle(
    shape: &Placed,
    form: &Form,
    corners: &[Point3<f64>; 3],
    need: f64,
) -> QuickLook {
    let least = |n: &Vector3<f64>| {
        let along = corners.iter().map(|c| n.dot(&(c - shape.center())));
        along.fold(f64::INFINITY, f64::min)
    };
    let separates = |n: &Vector3<f64>| least(n) - shape.support(form, n) >= need;
    let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
    if let Some(n) = normal.try_normalize(1e-18) {
        let n = if n.z > 0.0 { -n } else { n };
        if separates(&n) {
            return QuickLook::Apart;
        }
    }
    let (q, _) = nearest_on_triangle(&shape.center(), corners);
    let p = nearest_on_core(shape, &q);
    let (q, _) = nearest_on_triangle(&p, corners);
    match (q - p).try_normalize(1e-9) {
        Some(n) if separates(&n) => QuickLook::Apart,
        _ if shape.holds(form, &q) => QuickLook::Touching(q),
        _ => QuickLook::Unclear,
    }
}

fn nearest_on_core(shape: &Placed, q: &Point3<f64>) -> Point3<f64> {
    let length = shape.half.norm_squared();
    if length == 0.0 {
        return shape.center();
    }
    let t = (q - shape.center()).dot(&shape.half) / length;
    shape.center() + shape.half * t.clamp(-1.0, 1.0)
}

/// Steps that find the nearest point of a segment to a convex body: its place along the segment is
/// then known to 2^-12, and any point gives a valid direction.
const BISECTIONS: usize = 12;

/// The point of the core's segment nearest to a convex body that `nearest` projects to.
fn nearest_on_segment(
    shape: &Placed,
    nearest: impl Fn(&Point3<f64>) -> Point3<f64>,
) -> Point3<f64> {
    let (mut lo, mut hi) = (-1.0, 1.0);
    let at = |t: f64| shape.center() + shape.half * t;
    // The squared distance is convex along the segment: its slope changes sign once.
    let slope = |t: f64| {
        let p = at(t);
        (p - nearest(&p)).dot(&shape.half)
    };
    if slope(lo) >= 0.0 {
        return at(lo);
    }
    if slope(hi) <= 0.0 {
        return at(hi);
    }
    for _ in 0..BISECTIONS {
        let t = 0.5 * (lo + hi);
        if slope(t) > 0.0 { hi = t } else { lo = t }
    }
    at(0.5 * (lo + hi))
}

/// Nearest points of a core's segment and of a box.
fn segment_to_box(a: &Placed, b: &Placed, half: &Vector3<f64>) -> (Point3<f64>, Point3<f64>) {
    let into = |p: &Point3<f64>| b.frame.rotation.tr_mul(&(p - b.center()));
    let local = Placed {
        frame: Frame { rotation: a.frame.rotation, origin: into(&a.center()) },
        half: b.frame.rotation.tr_mul(&a.half),
        ..*a
    };
    let nearest = |p: &Point3<f64>| Point3::from(p.coords.sup(&-half).inf(half));
    let p = nearest_on_segment(&local, nearest);
    (b.frame.point(&p), b.frame.point(&nearest(&p)))
}

/// Nearest points of two cores' segments.
fn segment_to_segment(a: &Placed, b: &Placed) -> (Point3<f64>, Point3<f64>) {
    let between = b.frame.origin - a.frame.origin;
    let (aa, bb, ab) = (a.half.norm_squared(), b.half.norm_squared(), a.half.dot(&b.half));
    let (da, db) = (a.half.dot(&between), b.half.dot(&between));
    let along =
        |length: f64, t: f64| if length > 0.0 { (t / length).clamp(-1.0, 1.0) } else { 0.0 };
    let square = aa * bb - ab * ab;
    let mut s = if square > 1e-12 * aa * bb {
        ((da * bb - db * ab) / square).clamp(-1.0, 1.0)
    } else {
        0.0
    };
    let t = along(bb, s * ab - db);
    s = along(aa, t * ab + da);
    (a.center() + a.half * s, b.center() + b.half * t)
}

/// The point of a triangle nearest to `p`, and which corners span the face that it lies on
/// (Ericson, Real-Time Collision Detection, 5.1.5).
pub(crate) fn nearest_on_triangle(
    p: &Point3<f64>,
    [a, b, c]: &[Point3<f64>; 3],
) -> (Point3<f64>, [bool; 3]) {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return (*a, [true, false, false]);
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return (*b, [false, true, false]);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (a + ab * (d1 / (d1 - d3)), [true, true, false]);
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return (*c, [false, false, true]);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (a + ac * (d2 / (d2 - d6)), [true, false, true]);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return (b + (c - b) * t, [false, true, true]);
    }
    let whole = va + vb + vc;
    if whole.abs() < f64::MIN_POSITIVE {
        return (*a, [true, false, false]);
    }
    (a + ab * (vb / whole) + ac * (vc / whole), [true; 3])
}
