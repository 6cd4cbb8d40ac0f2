//! Slower methods that share no code with the crate.

use nalgebra::{Matrix3, Point2, Point3, UnitQuaternion, Vector3};
use std::f64::consts::{PI, TAU};

/// Inside the hull of `points` if no line through p has all points on one side: the largest
/// angular gap between the points, seen from p, is at most a half turn.
pub fn inside_hull(points: &[Point2<f64>], p: Point2<f64>) -> bool {
    let mut angles: Vec<f64> = points.iter().map(|q| (q.y - p.y).atan2(q.x - p.x)).collect();
    angles.sort_by(f64::total_cmp);
    let wrap = angles[0] + TAU - angles[angles.len() - 1];
    angles.windows(2).map(|w| w[1] - w[0]).fold(wrap, f64::max) <= PI
}

/// Inside the conservative polygon if inside the hull of the contacts whichever one is lost.
pub fn survives_any_loss(contacts: &[Point3<f64>], p: Point2<f64>) -> bool {
    (0..contacts.len()).all(|lost| {
        let others: Vec<Point2<f64>> =
            contacts.iter().enumerate().filter(|(i, _)| *i != lost).map(|(_, c)| c.xy()).collect();
        inside_hull(&others, p)
    })
}

/// The margin that is left when contact `k` settles by `s`: every pair of other feet is tried as
/// the line that all other feet rise about, and the turn is found by creeping and bisection.
pub fn settled_margin(contacts: &[Point3<f64>], k: usize, com: &Point3<f64>, s: f64) -> f64 {
    let others: Vec<Point3<f64>> =
        contacts.iter().enumerate().filter(|(i, _)| *i != k).map(|(_, c)| *c).collect();
    let flat: Vec<Point2<f64>> = others.iter().map(Point3::xy).collect();
    if flat.len() >= 3 && inside_hull(&flat, com.xy()) {
        let all: Vec<Point2<f64>> = contacts.iter().map(Point3::xy).collect();
        return depth_by_sampled_directions(&all, com.xy());
    }
    let mut best = f64::NEG_INFINITY;
    for a in &others {
        for b in &others {
            let side = |p: &Point3<f64>| (b - a).xy().perp(&(p - a).xy());
            let spans = others.iter().all(|p| side(p) >= -1e-12) && a != b;
            if spans && side(com) < 0.0 {
                best = best.max(after_turn([a, b], contacts, &contacts[k], com, s));
            }
        }
    }
    best
}

/// Support function of the hull, over very many directions: the depth of a point inside.
fn depth_by_sampled_directions(points: &[Point2<f64>], p: Point2<f64>) -> f64 {
    let reach = |angle: f64| {
        let (sin, cos) = angle.sin_cos();
        points.iter().map(|q| (q.x - p.x) * cos + (q.y - p.y) * sin).fold(f64::MIN, f64::max)
    };
    // The least reach is along the normal of a side, between two samples: refine around it.
    let n = 2_000;
    let coarse = (0..n)
        .map(|i| TAU * f64::from(i) / f64::from(n))
        .min_by(|a, b| reach(*a).total_cmp(&reach(*b)))
        .expect("there are directions");
    let (mut lo, mut hi) = (coarse - TAU / f64::from(n), coarse + TAU / f64::from(n));
    for _ in 0..60 {
        let (t1, t2) = (lo + (hi - lo) / 3.0, hi - (hi - lo) / 3.0);
        if reach(t1) < reach(t2) { hi = t2 } else { lo = t1 }
    }
    reach(0.5 * (lo + hi))
}

fn after_turn(
    [a, b]: [&Point3<f64>; 2],
    contacts: &[Point3<f64>],
    foot: &Point3<f64>,
    com: &Point3<f64>,
    s: f64,
) -> f64 {
    let turned = |p: &Point3<f64>, t: f64| {
        a + UnitQuaternion::from_scaled_axis((b - a).normalize() * t) * (p - a)
    };
    let sunk = |t: f64| foot.z - turned(foot, t).z;
    let direction = if sunk(1e-6) > 0.0 { 1.0 } else { -1.0 };
    let step = 1e-3;
    let Some(n) = (1..3_000).find(|n| sunk(direction * step * f64::from(*n)) >= s) else {
        return f64::NEG_INFINITY;
    };
    let (mut lo, mut hi) = (direction * step * f64::from(n - 1), direction * step * f64::from(n));
    for _ in 0..60 {
        let mid = 0.5 * (lo + hi);
        if sunk(mid) >= s { hi = mid } else { lo = mid }
    }
    let feet: Vec<Point2<f64>> = contacts.iter().map(|p| turned(p, hi).xy()).collect();
    depth_by_sampled_directions(&feet, turned(com, hi).xy())
}

/// Loads of equal springs by trying every set of carrying feet: the one whose linear loads are
/// none negative, while the others would be pulled. Three feet or more carry, borders apart.
pub fn spring_loads(contacts: &[Point3<f64>], com: &Point3<f64>, weight: f64) -> Option<Vec<f64>> {
    preloaded_loads(contacts, com, weight, &vec![0.0; contacts.len()])
}

/// As [`spring_loads`], each foot with a load of its own (N) before the rover sinks and tilts.
pub fn preloaded_loads(
    contacts: &[Point3<f64>],
    com: &Point3<f64>,
    weight: f64,
    preload: &[f64],
) -> Option<Vec<f64>> {
    let row = |p: &Point3<f64>| Vector3::new(1.0, p.x, p.y);
    let sets = (1_u32..1 << contacts.len()).filter(|set| set.count_ones() >= 3);
    sets.into_iter().find_map(|set| {
        let carries = |i: usize| set >> i & 1 == 1;
        let mut stiffness = Matrix3::zeros();
        let mut missing = row(com) * weight;
        for (i, p) in contacts.iter().enumerate() {
            if carries(i) {
                stiffness += row(p) * row(p).transpose();
                missing -= row(p) * preload[i];
            }
        }
        let plane = stiffness.try_inverse()? * missing;
        let loads: Vec<f64> =
            contacts.iter().zip(preload).map(|(p, own)| plane.dot(&row(p)) + own).collect();
        let slack = 1e-9 * weight;
        let right = loads
            .iter()
            .enumerate()
            .all(|(i, f)| if carries(i) { *f >= -slack } else { *f <= slack });
        right.then(|| {
            let load = |(i, f): (usize, &f64)| if carries(i) { *f } else { 0.0 };
            loads.iter().enumerate().map(load).collect()
        })
    })
}
