//! The solid ground: how far a shape is from it.

use nalgebra::{Point2, Point3, Vector3};
use parry3d_f64::shape::Triangle;
use terrain::ElevationMap;

use crate::form::{Placed, QuickLook, apart_from_block, look_at_triangle, nearest_on_triangle};
use crate::gjk::{Separation, separation};
use crate::scene::Scene;
use crate::solid::{Near, Part, near, pose_of, to_parry_point};
use parry3d_f64::math::Pose;

/// Difference of distances that does not matter (m): about what parry leaves open on curved shapes.
pub(crate) const EQUALLY_NEAR: f64 = 5e-5;

/// What a shape is to the ground.
pub(crate) enum GroundNear {
    /// At least as far as asked.
    Clear,
    /// Over ground that nobody has seen, or beside the map, at this place.
    Unknown(Point3<f64>),
    /// Nearer than asked.
    Near(Near),
}

/// Is the part surely `need` (m) or more above all ground, known without holes? `false` is no
/// answer; a `thorough` look goes down to the triangles.
pub(crate) fn clear_of_ground(
    scene: &Scene,
    part: &Part,
    placed: &Placed,
    need: f64,
    thorough: bool,
) -> bool {
    let aabb = placed.aabb(&part.form);
    let (min, max) = grown(&aabb, need);
    if beside_map(scene, min, max) || over_a_hole(scene, min, max) {
        return false;
    }
    let map = scene.cover();
    if map.max_over(min, max) <= aabb.0.z - need {
        return true;
    }
    if !thorough {
        return false;
    }
    let center = placed.center();
    if map.height_at(center.xy()).is_none_or(|ground| ground >= center.z) {
        return false;
    }
    let mut clear = true;
    map.pyramid().descend(
        min,
        max,
        |block| !apart_from_block(placed, &part.form, &aabb, block, need),
        |ix, iy| {
            clear = triangles(scene, ix, iy).into_iter().flatten().all(|corners| {
                look_at_triangle(placed, &part.form, &corners, need) == QuickLook::Apart
            });
            clear
        },
    );
    clear
}

/// Who says how far two shapes are apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Kernel {
    /// Our own distances, as well as the question needs them and never too great: for searches, which
    /// are content with any ground nearer than `enough` (m).
    Quick { enough: f64 },
    /// parry's exact ones: for verdicts, so that these do not rest on what the search rests on.
    Exact,
}

/// The distance of a part from the solid ground, if less than `reach` (m). Ground must be known within
/// `required` (m) beside the part.
pub(crate) fn near_ground(
    scene: &Scene,
    part: &Part,
    placed: &Placed,
    required: f64,
    reach: f64,
    kernel: Kernel,
) -> GroundNear {
    let (min, max) = grown(&placed.aabb(&part.form), required);
    if beside_map(scene, min, max) || over_a_hole(scene, min, max) {
        return GroundNear::Unknown(placed.center());
    }
    near_known_ground(scene, part, placed, reach, kernel)
        .map_or(GroundNear::Clear, GroundNear::Near)
}

/// As [`near_ground`], for the ground that is known: what is not counts as nothing.
pub(crate) fn near_known_ground(
    scene: &Scene,
    part: &Part,
    placed: &Placed,
    reach: f64,
    kernel: Kernel,
) -> Option<Near> {
    let map = scene.cover();
    let aabb = placed.aabb(&part.form);
    let center = placed.center();
    if let Some(ground) = map.height_at(center.xy()) {
        let below = Point3::new(center.x, center.y, ground);
        if ground >= center.z || placed.holds(&part.form, &below) {
            return Some(Near { distance: 0.0, place: below });
        }
    }
    // The ground below the lowest point is no nearer than the nearest ground: nothing farther is worth
    // a look.
    let lowest = placed.support_point(&part.form, &-Vector3::z());
    let mut reach = reach;
    let mut below = None;
    if let Some(ground) = map.height_at(lowest.xy()) {
        let place = Point3::new(lowest.x, lowest.y, ground);
        if ground >= lowest.z {
            return Some(Near { distance: 0.0, place });
        }
        let gap = lowest.z - ground;
        if gap + EQUALLY_NEAR < reach {
            reach = gap + EQUALLY_NEAR;
            below = Some(Near { distance: gap, place });
        }
    }
    let (min, max) = grown(&aabb, reach);
    let mut nearest: Option<Near> = None;
    // Another triangle has to beat the nearest one so far by what is not mere rounding.
    let bar = std::cell::Cell::new(reach);
    let enough = match kernel {
        Kernel::Quick { enough } => enough,
        Kernel::Exact => 0.0,
    };
    map.pyramid().descend(
        min,
        max,
        |block| !apart_from_block(placed, &part.form, &aabb, block, bar.get()),
        |ix, iy| {
            for corners in triangles(scene, ix, iy).into_iter().flatten() {
                let hit = match look_at_triangle(placed, &part.form, &corners, bar.get()) {
                    QuickLook::Apart => continue,
                    QuickLook::Touching(place) => Some(Near { distance: 0.0, place }),
                    QuickLook::Unclear => {
                        distance_of_triangle(part, placed, &corners, bar.get(), kernel)
                    }
                };
                if let Some(hit) = hit {
                    bar.set(nearer_than(hit.distance));
                    nearest = Some(hit);
                    if hit.distance <= enough {
                        return false;
                    }
                }
            }
            true
        },
    );
    nearest.or(below)
}

/// Is the part nearer than `required` (m) to the ground about `place`, or in it? `false` is no answer:
/// nearer ground may be elsewhere.
pub(crate) fn is_near_ground_at(
    scene: &Scene,
    part: &Part,
    placed: &Placed,
    place: Point2<f64>,
    required: f64,
) -> bool {
    let grid = scene.cover().grid();
    let at = (place - grid.origin) / grid.resolution;
    if !(at.x >= 0.0 && at.y >= 0.0) {
        return false;
    }
    let kernel = Kernel::Quick { enough: required };
    triangles(scene, at.x as usize, at.y as usize).into_iter().flatten().any(|corners| {
        match look_at_triangle(placed, &part.form, &corners, required) {
            QuickLook::Apart => false,
            QuickLook::Touching(_) => true,
            QuickLook::Unclear => {
                let near = distance_of_triangle(part, placed, &corners, required, kernel);
                near.is_some_and(|near| near.distance < required)
            }
        }
    })
}

/// Distance (m) below which a triangle is nearer than one at `limit` (m): on level ground all are
/// equally near, but for the last digits of parry's distances.
fn nearer_than(limit: f64) -> f64 {
    (limit - EQUALLY_NEAR).max(0.5 * limit)
}

/// Is all ground below a part known?
pub(crate) fn is_known_below(scene: &Scene, part: &Part, placed: &Placed) -> bool {
    let (min, max) = grown(&placed.aabb(&part.form), 0.0);
    !beside_map(scene, min, max) && !over_a_hole(scene, min, max)
}

/// The highest ground over a rectangle (m), if all of it is known.
pub(crate) fn highest_known(scene: &Scene, min: Point2<f64>, max: Point2<f64>) -> Option<f64> {
    let known = !beside_map(scene, min, max) && !over_a_hole(scene, min, max);
    known.then(|| scene.cover().max_over(min, max))
}

fn distance_of_triangle(
    part: &Part,
    placed: &Placed,
    corners: &[Point3<f64>; 3],
    limit: f64,
    kernel: Kernel,
) -> Option<Near> {
    match kernel {
        Kernel::Exact => {
            // parry is dear where curved shapes are near: it is asked where our bound leaves doubt.
            if separation(&(placed, &part.form), corners, limit) == Separation::Apart {
                return None;
            }
            let [a, b, c] = corners.map(|p| to_parry_point(&p));
            let (pose, triangle) = (pose_of(&placed.frame), Triangle::new(a, b, c));
            near(&pose, &*part.shape.0, &Pose::IDENTITY, &triangle, limit)
        }
        Kernel::Quick { .. } => match separation(&(placed, &part.form), corners, limit) {
            Separation::Apart => None,
            Separation::Near { least, .. } => {
                let place = nearest_on_triangle(&placed.center(), corners).0;
                Some(Near { distance: least, place })
            }
        },
    }
}

fn grown((lo, hi): &(Point3<f64>, Point3<f64>), by: f64) -> (Point2<f64>, Point2<f64>) {
    (Point2::new(lo.x - by, lo.y - by), Point2::new(hi.x + by, hi.y + by))
}

/// Does a map know all ground over a rectangle?
pub(crate) fn is_all_known(map: &ElevationMap, min: Point2<f64>, max: Point2<f64>) -> bool {
    is_within(map, min, max) && !has_a_hole(map, min, max)
}

fn beside_map(scene: &Scene, min: Point2<f64>, max: Point2<f64>) -> bool {
    !is_within(scene.cover(), min, max)
}

fn is_within(map: &ElevationMap, min: Point2<f64>, max: Point2<f64>) -> bool {
    let grid = map.grid();
    let far = grid.far_corner();
    // Not so where a coordinate is no number.
    min.x >= grid.origin.x && min.y >= grid.origin.y && max.x <= far.x && max.y <= far.y
}

/// Does the rectangle touch a square of the map with an unknown corner?
fn over_a_hole(scene: &Scene, min: Point2<f64>, max: Point2<f64>) -> bool {
    has_a_hole(scene.cover(), min, max)
}

fn has_a_hole(map: &ElevationMap, min: Point2<f64>, max: Point2<f64>) -> bool {
    let Some(holes) = map.holes() else { return false };
    let mut found = false;
    holes.descend(
        min,
        max,
        |block| block.top > 0.0,
        |_, _| {
            found = true;
            false
        },
    );
    found
}

/// The two triangles of a square, where their corners are known.
fn triangles(scene: &Scene, ix: usize, iy: usize) -> [Option<[Point3<f64>; 3]>; 2] {
    let (grid, heights) = (scene.cover().grid(), scene.cover().heights());
    if ix + 1 >= grid.nx || iy + 1 >= grid.ny {
        return [None, None];
    }
    let node = |ix: usize, iy: usize| {
        let p = grid.position(ix, iy);
        Point3::new(p.x, p.y, f64::from(*heights.at(ix, iy)))
    };
    let (b, c) = (node(ix + 1, iy), node(ix, iy + 1));
    [node(ix, iy), node(ix + 1, iy + 1)].map(|a| {
        let known = a.z.is_finite() && b.z.is_finite() && c.z.is_finite();
        known.then_some([a, b, c])
    })
}
