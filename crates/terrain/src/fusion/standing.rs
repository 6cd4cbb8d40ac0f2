//! Room that is known to be empty: where a wheel stands there is no ground.
//!
//! The ground between nodes is triangles, so what keeps a wheel clear of it is a plane under the wheel for each
//! triangle below it: no corner may be above. Of a triangle that plane touches the wheel where the triangle is
//! nearest to the wheel's bottom, or is level at the wheel's lowest point, whichever leaves its corners higher. A
//! plane that touches a convex body is nowhere above it, so whatever the heights were before, corners that keep
//! below their planes give a surface that does not reach into the wheel; and no corner need be below the lowest
//! point of the wheel.

use std::collections::BTreeMap;

use nalgebra::{Point2, Point3, Unit, Vector2, Vector3};

use super::version::{INDEX_MAX, MapVersion};
use crate::TerrainError;

/// Half-planes that the wheel's shadow is taken from: exact for a level axle, else 1.2 mm too wide for a radius of
/// 0.26 m.
const SIDES: usize = 32;
/// Cosine and sine of the angle between them. Not asked of the machine: the same bytes are to come of it everywhere.
const SIDE_TURN: [f64; 2] = [0.980_785_280_403_230_4, 0.195_090_322_016_128_27];
/// Steepest plane under a wheel: sine of its slope across the axle.
const STEEPEST: f64 = 0.95;

/// A wheel, or a ball foot, as it stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StandingWheel {
    /// Its center (m).
    pub center_m: Point3<f64>,
    /// Direction of its axle.
    pub axle: Unit<Vector3<f64>>,
    /// Its radius (m).
    pub radius_m: f64,
    /// Its width along the axle (m).
    pub width_m: f64,
    /// Is it a ball?
    pub ball: bool,
}

/// No ground is above the plane through a point with a normal.
struct Plane(Point3<f64>, Unit<Vector3<f64>>);

impl Plane {
    fn height(&self, p: Point2<f64>) -> f64 {
        self.0.z - self.1.xy().dot(&(p - self.0.xy())) / self.1.z
    }
}

impl StandingWheel {
    pub(super) fn check(&self, resolution_m: f64) -> Result<(), TerrainError> {
        let check = TerrainError::check;
        let limit = 0.5 * resolution_m * f64::from(INDEX_MAX);
        check("center_m.x", self.center_m.x, [-limit, limit], "a place on the map's lattice")?;
        check("center_m.y", self.center_m.y, [-limit, limit], "a place on the map's lattice")?;
        check("center_m.z", self.center_m.z, [-1e7, 1e7], "a height within 1e7 m")?;
        check("axle (length)", self.axle.norm(), [0.999, 1.001], "a direction of length 1")?;
        let most = 200.0 * resolution_m;
        let expected = "a length over 0, of at most 200 cells";
        check("radius_m", self.radius_m, [1e-6, most], expected)?;
        check("width_m", self.width_m, [1e-6, most], expected).map(drop)
    }

    /// How far it extends in a direction of length 1 (m).
    fn extent(&self, direction: &Vector3<f64>) -> f64 {
        if self.ball {
            return self.radius_m;
        }
        let along = direction.dot(&self.axle);
        0.5 * self.width_m * along.abs() + self.radius_m * (1.0 - along * along).max(0.0).sqrt()
    }

    /// The plane with an upward normal that touches it from below.
    fn plane(&self, normal: Unit<Vector3<f64>>) -> Plane {
        Plane(self.center_m - normal.into_inner() * self.extent(&normal), normal)
    }

    /// Lattice indices of the nodes that may have to do with it.
    pub(super) fn ends(&self, resolution_m: f64) -> ([i32; 2], [i32; 2]) {
        let half = [self.extent(&Vector3::x()), self.extent(&Vector3::y())];
        let node = |v: f64| v / resolution_m;
        let low = [0, 1].map(|i| node(self.center_m[i] - half[i]).floor() as i32 - 1);
        let high = [0, 1].map(|i| node(self.center_m[i] + half[i]).ceil() as i32 + 1);
        (low, high)
    }

    /// What no node of the ground about it can be above (m), by lattice index, for a lattice of this resolution. Nodes
    /// that are not told of have no part in the ground below it.
    pub fn ceilings(&self, resolution_m: f64) -> BTreeMap<[i32; 2], f64> {
        let mut ceilings = BTreeMap::new();
        let (low, high) = self.ends(resolution_m);
        for iy in low[1]..high[1] {
            for ix in low[0]..high[0] {
                let diagonal = [[ix + 1, iy], [ix, iy + 1]];
                for corner in [[ix, iy], [ix + 1, iy + 1]] {
                    let nodes = [corner, diagonal[0], diagonal[1]];
                    let at = nodes.map(|n| Point2::from(n.map(f64::from)) * resolution_m);
                    let Some(plane) = self.plane_over(at) else { continue };
                    for (node, p) in nodes.into_iter().zip(at) {
                        let height = plane.height(p);
                        let most = ceilings.entry(node).or_insert(height);
                        *most = most.min(height);
                    }
                }
            }
        }
        ceilings
    }

    /// The node where ground of a map reaches highest over what it can be, and by how much (m); none where none does.
    /// Heights that contradict each other are not ground.
    pub fn reached_into(&self, map: &MapVersion) -> Option<([i32; 2], f64)> {
        let ceilings = self.ceilings(map.resolution_m()).into_iter();
        let over = ceilings.filter_map(|(index, ceiling)| {
            let cell = map.cell(index);
            let over = f64::from(cell.height_m) - ceiling;
            (over > 0.0 && cell.rival.is_none()).then_some((index, over))
        });
        over.max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The plane for a triangle; none where it is not below.
    fn plane_over(&self, triangle: [Point2<f64>; 3]) -> Option<Plane> {
        let below = self.below(triangle);
        if below.is_empty() {
            return None;
        }
        let lowest =
            |plane: &Plane| triangle.iter().map(|p| plane.height(*p)).fold(f64::INFINITY, f64::min);
        let level = self.plane(Vector3::z_axis());
        let leaning = self.leaning(&below).map(|normal| self.plane(normal));
        Some(match leaning {
            Some(leaning) if lowest(&leaning) > lowest(&level) => leaning,
            _ => level,
        })
    }

    /// What of a triangle is below it: a polygon, as offsets from its center; empty if nothing is.
    fn below(&self, triangle: [Point2<f64>; 3]) -> Vec<Vector2<f64>> {
        let mut polygon = triangle.map(|p| p - self.center_m.xy()).to_vec();
        let mut out = self.axle.xy().try_normalize(1e-9).unwrap_or(Vector2::x());
        for _ in 0..SIDES {
            let [cos, sin] = SIDE_TURN;
            out = Vector2::new(cos * out.x - sin * out.y, sin * out.x + cos * out.y);
            let limit = self.extent(&Vector3::new(out.x, out.y, 0.0));
            polygon = clipped(&polygon, out, limit);
            if polygon.is_empty() {
                break;
            }
        }
        polygon
    }

    /// The normal, where the wheel is over a place of the polygon that is nearest to its bottom.
    fn leaning(&self, below: &[Vector2<f64>]) -> Option<Unit<Vector3<f64>>> {
        if self.ball {
            let nearest = below.iter().min_by(|a, b| a.norm().total_cmp(&b.norm()))?;
            let sine = nearest / self.radius_m;
            let sine = sine * (STEEPEST / sine.norm().max(STEEPEST));
            let up = (1.0 - sine.norm_squared()).sqrt();
            return Some(Unit::new_normalize(Vector3::new(-sine.x, -sine.y, up)));
        }
        // A point of the wheel's round is as far off along `heading` as its normal leans there.
        let heading = Unit::try_new(Vector3::new(-self.axle.y, self.axle.x, 0.0), 1e-6)?;
        let up = self.axle.cross(&heading);
        let up = if up.z < 0.0 { -up } else { up };
        let along = below.iter().map(|p| p.dot(&heading.xy()));
        let (low, high) = along
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        let sine = (0.0_f64.clamp(low, high) / self.radius_m).clamp(-STEEPEST, STEEPEST);
        let normal = up * (1.0 - sine * sine).sqrt() - heading.into_inner() * sine;
        (normal.z > 0.1).then(|| Unit::new_normalize(normal))
    }
}

/// What of a convex polygon is not farther out than a limit.
fn clipped(polygon: &[Vector2<f64>], out: Vector2<f64>, limit: f64) -> Vec<Vector2<f64>> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, b) in polygon.iter().enumerate() {
        let a = polygon[(i + polygon.len() - 1) % polygon.len()];
        let [from, to] = [a, *b].map(|p| p.dot(&out) - limit);
        if (from < 0.0) != (to < 0.0) {
            kept.push(a + (b - a) * (from / (from - to)));
        }
        if to < 0.0 {
            kept.push(*b);
        }
    }
    kept
}
