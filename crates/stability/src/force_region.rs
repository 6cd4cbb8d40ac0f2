//! Where the center of mass may be so that forces that the contacts can give hold the rover.
//!
//! With friction limited, a stance holds on the projection to x and y of all centers of mass and
//! contact forces in balance (H7 to H11; Bretl & Lall, IEEE T-RO 2008). Forces are mixes of unit
//! forces: the edges of linearized friction cones, or the corners of bounded sets, where joint
//! torques (H12) or a rope limit them. In units of the weight, with unit forces d at p,
//!
//! Σ λ d = (0, 0, 1),  Σ λ (p × d)_z = 0,  center of mass (x, y) = Σ λ (-(p × d)_y, (p × d)_x),  λ ≥ 0.
//!
//! That is a linear program with four balances, and the region is the shadow of its feasible set:
//! the crate's simplex walks around it, one pivot a vertex. The outline is exact for the
//! linearized cones; whether these lie inside or outside of the true ones is the caller's choice.
//!
//! On walls that face each other, feet may push against each other without limit and hold any
//! center of mass. So that every region is bounded and every answer is one of a real rover, all
//! unit forces together are limited to [`FORCE_CAP`] times the weight.
//!
//! Frame `g` (z up), meters, newtons.

use geometry::{ConvexPolygon, ConvexRegion};
use nalgebra::{Point2, Point3, Unit, Vector3};

use crate::contact::{self, ConeModel, Contact, ContactError};
use crate::contact_forces::LegStatics;
use crate::simplex::{ShadowVertex, Tableau};
use crate::support_polygon::{self, HalfPlane, cut};

/// Most that all unit forces together may be, in weights.
pub const FORCE_CAP: f64 = 100.0;

/// Regions that come this near to each other (m) touch.
const TOUCH: f64 = 1e-8;

/// Directions in which a region is sampled should its outline not be found.
const FALLBACK_DIRECTIONS: usize = 64;

/// Forces that one contact can give: mixes of `corners`, which sum to one, and of `rays`, which may
/// have any size. Without corners, the rays begin at zero.
#[derive(Debug, Clone, PartialEq)]
pub struct ForceSet {
    /// Where the force acts (m).
    pub position: Point3<f64>,
    /// Directions without limit.
    pub rays: Vec<Vector3<f64>>,
    /// Corners of a bounded set (N).
    pub corners: Vec<Vector3<f64>>,
}

impl ForceSet {
    /// The linearized friction cone of a foot, in a stance with this center.
    pub fn cone(contact: &Contact, center: &Point3<f64>, cone: ConeModel) -> ForceSet {
        let rays = cone.rays(contact, center);
        ForceSet { position: contact.position, rays, corners: Vec::new() }
    }

    /// A rope fixed to the rover at `position` (m) that pulls along `direction` with 0 up to
    /// `max_tension` (N) (H48).
    pub fn tether(
        position: Point3<f64>,
        direction: Unit<Vector3<f64>>,
        max_tension: f64,
    ) -> ForceSet {
        let corners = vec![Vector3::zeros(), direction.into_inner() * max_tension.max(0.0)];
        ForceSet { position, rays: Vec::new(), corners }
    }
}

/// Forces within the linearized friction cone of a foot under which no joint of its leg is loaded
/// beyond its limit (H12); `None` if there is none, for a leg too weak to hold its own links.
///
/// The set's corners are where three of its faces meet: sides of the cone, a joint at either limit,
/// and the force along the normal at [`FORCE_CAP`] times `weight` (N), should no joint end it.
pub fn within_torque(
    contact: &Contact,
    center: &Point3<f64>,
    cone: ConeModel,
    leg: &LegStatics,
    weight: f64,
) -> Option<ForceSet> {
    let normal = contact.normal.into_inner();
    // Faces as n · f ≥ -d, with n of length 1 and forces in weights.
    let mut faces: Vec<(Vector3<f64>, f64)> = vec![(normal, 0.0), (-normal, FORCE_CAP)];
    faces.extend(cone.half_spaces(contact, center).into_iter().map(|n| (n.normalize(), 0.0)));
    for joint in 0..leg.own.len() {
        let limit = leg.limits[joint] / weight;
        if limit <= 0.0 {
            continue;
        }
        let own = leg.own[joint] / weight;
        let lever = Vector3::from_fn(|k, _| leg.per_force[k][joint]);
        for sign in [1.0, -1.0] {
            match (lever * -sign).try_normalize(1e-12) {
                Some(n) => faces.push((n, (limit - sign * own) / lever.norm())),
                None if limit < sign * own => return None,
                None => {}
            }
        }
    }
    let corners = corners(&faces);
    (!corners.is_empty()).then(|| ForceSet {
        position: contact.position,
        rays: Vec::new(),
        corners: corners.into_iter().map(|f| f * weight).collect(),
    })
}

/// The corners of the bounded set n · f ≥ -d over all faces (n, d).
fn corners(faces: &[(Vector3<f64>, f64)]) -> Vec<Vector3<f64>> {
    let mut corners: Vec<Vector3<f64>> = Vec::new();
    for (i, (a, da)) in faces.iter().enumerate() {
        for (j, (b, db)) in faces.iter().enumerate().skip(i + 1) {
            let along = a.cross(b);
            if along.norm_squared() < 1e-12 {
                continue;
            }
            for (c, dc) in &faces[j + 1..] {
                let volume = along.dot(c);
                if volume.abs() < 1e-9 {
                    continue;
                }
                let f = -(b.cross(c) * *da + c.cross(a) * *db + along * *dc) / volume;
                let within = |(n, d): &(Vector3<f64>, f64)| n.dot(&f) >= -d - 1e-9;
                if faces.iter().all(within) && corners.iter().all(|k| (k - f).norm() > 1e-9) {
                    corners.push(f);
                }
            }
        }
    }
    corners
}

/// Friction cones of all contacts of a stance.
pub fn cones(contacts: &[Contact], cone: ConeModel) -> Result<Vec<ForceSet>, ContactError> {
    contact::check(contacts)?;
    cone.check()?;
    let center = contact::center(contacts.iter().map(|c| c.position));
    Ok(contacts.iter().map(|c| ForceSet::cone(c, &center, cone)).collect())
}

/// Why no center of mass is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Emptiness {
    /// No forces of these contacts sum up to the weight: the ground is too steep for its friction,
    /// or joints or ropes are too weak.
    Slides,
    /// Forces that carry the weight would turn the rover about gravity.
    Twists,
    /// A leg is too weak to hold its own links.
    Overloaded,
    /// Nothing is left once any one contact is lost.
    NoneSurvives,
}

/// The region of centers of mass that are held.
#[derive(Debug, Clone, PartialEq)]
pub struct ForceRegion {
    /// The region, in x and y of `g` (m). A segment (two contacts) counts as its middle.
    pub region: ConvexRegion,
    /// Why it is empty; `None` if it is not.
    pub emptiness: Option<Emptiness>,
    /// For each edge of an area, the contacts that bear there: with the center of mass beyond it,
    /// they would slip, tip or be overloaded.
    pub bearing: Vec<Vec<usize>>,
    /// True if it reaches so far only because feet push against each other with [`FORCE_CAP`].
    pub capped: bool,
}

impl ForceRegion {
    pub(crate) fn empty(emptiness: Emptiness) -> ForceRegion {
        let region = ConvexRegion::Empty;
        ForceRegion { region, emptiness: Some(emptiness), bearing: Vec::new(), capped: false }
    }

    /// How far the center of mass may move, seen along gravity, before it leaves the region (m);
    /// negative outside, for a point minus the distance to it, `None` for an empty region.
    pub fn margin(&self, com: &Point3<f64>) -> Option<f64> {
        support_polygon::margin_of_region(&self.region, com)
    }

    /// The contacts that bear at the edge nearest to the center of mass.
    pub fn critical(&self, com: &Point3<f64>) -> &[usize] {
        let area = self.region.area();
        let edge = area.map(|polygon| polygon.depth_and_edge(com.xy()).1);
        edge.and_then(|edge| self.bearing.get(edge)).map_or(&[], Vec::as_slice)
    }
}

/// The region of centers of mass that forces of these sets hold under `weight` (N).
pub fn region(sets: &[ForceSet], weight: f64) -> Result<ForceRegion, ContactError> {
    check(sets, weight)?;
    Ok(region_of(&sets.iter().collect::<Vec<_>>(), weight))
}

/// What is left of the region should any one contact, or rope, be lost (F40 with friction).
///
/// `bearing` then tells the contacts that bear at an edge, and the lost one is not among them.
pub fn conservative(sets: &[ForceSet], weight: f64) -> Result<ForceRegion, ContactError> {
    check(sets, weight)?;
    let mut regions = Vec::with_capacity(sets.len());
    for lost in 0..sets.len() {
        let others: Vec<&ForceSet> =
            sets.iter().enumerate().filter(|(i, _)| *i != lost).map(|(_, set)| set).collect();
        if others.is_empty() {
            return Ok(ForceRegion::empty(Emptiness::NoneSurvives));
        }
        let mut one = region_of(&others, weight);
        for bearing in &mut one.bearing {
            bearing.iter_mut().for_each(|i| *i += usize::from(*i >= lost));
        }
        regions.push(one);
    }
    let region = shared(&regions);
    if region == ConvexRegion::Empty {
        return Ok(ForceRegion::empty(Emptiness::NoneSurvives));
    }
    let bearing = region.area().map_or_else(Vec::new, |area| {
        area.edges().map(|(a, b)| bearing_of(&regions, nalgebra::center(&a, &b))).collect()
    });
    let capped = regions.iter().any(|one| one.capped);
    Ok(ForceRegion { region, emptiness: None, bearing, capped })
}

/// What all regions share.
fn shared(regions: &[ForceRegion]) -> ConvexRegion {
    let rings = regions.iter().map(|one| match &one.region {
        ConvexRegion::Area(area) => area.vertices().to_vec(),
        ConvexRegion::Point(p) => vec![*p],
        ConvexRegion::Empty => Vec::new(),
    });
    let extent =
        |ring: &Vec<Point2<f64>>| ring.iter().map(|p| (p - ring[0]).norm()).fold(0.0, f64::max);
    // The smallest is cut by all others: a point can be cut by an area, not the other way around.
    let Some(mut ring) = rings.min_by(|a, b| extent(a).total_cmp(&extent(b))) else {
        return ConvexRegion::Empty;
    };
    for one in regions {
        match &one.region {
            ConvexRegion::Area(area) => {
                for (a, b) in area.edges() {
                    ring = cut(&ring, &HalfPlane::left_of(a, b), TOUCH);
                }
            }
            ConvexRegion::Point(p) => ring.retain(|q| (p - q).norm() < TOUCH),
            ConvexRegion::Empty => return ConvexRegion::Empty,
        }
    }
    support_polygon::region_of_ring(ring)
}

/// Who bears at the edge, of all regions, that lies nearest to a point.
fn bearing_of(regions: &[ForceRegion], point: Point2<f64>) -> Vec<usize> {
    regions
        .iter()
        .filter_map(|one| {
            let (depth, edge) = one.region.area()?.depth_and_edge(point);
            Some((depth.abs(), one.bearing.get(edge)?))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map_or_else(Vec::new, |(_, bearing)| bearing.clone())
}

pub(crate) fn check(sets: &[ForceSet], weight: f64) -> Result<(), ContactError> {
    let n_contacts = sets.len();
    if n_contacts == 0 {
        return Err(ContactError::NoContacts);
    }
    if n_contacts > contact::MAX_CONTACTS {
        return Err(ContactError::TooManyContacts { n_contacts });
    }
    if !(weight.is_finite() && weight > 0.0) {
        return Err(ContactError::BadWeight);
    }
    for (contact, set) in sets.iter().enumerate() {
        let forces = set.rays.iter().chain(&set.corners).flat_map(|f| f.iter());
        if !set.position.iter().chain(forces).copied().all(f64::is_finite) {
            return Err(ContactError::NotFinite { contact });
        }
    }
    Ok(())
}

/// The linear program of a stance, in units of the weight and of the stance's size.
struct Balance {
    center: Point3<f64>,
    size: f64,
    columns: Vec<(Vec<f64>, [f64; 2])>,
    /// The contact of each column; the last column is what is left of [`FORCE_CAP`].
    owner: Vec<usize>,
    right_side: Vec<f64>,
}

/// What a force at `p` gives to the balances of forces and of the twist and takes of the cap, and
/// where it puts the center of mass.
pub(crate) fn unit_force(p: &Vector3<f64>, force: &Vector3<f64>) -> ([f64; 5], [f64; 2]) {
    let moment = p.cross(force);
    let balance = [force.x, force.y, force.z, moment.z, force.norm() / FORCE_CAP];
    (balance, [-moment.y, moment.x])
}

impl Balance {
    fn new(sets: &[&ForceSet], weight: f64) -> Balance {
        let center = contact::center(sets.iter().map(|set| set.position));
        let size = sets.iter().map(|set| (set.position - center).norm()).fold(0.0, f64::max);
        let size = if size > 1e-9 { size } else { 1.0 };
        let bounded: Vec<usize> = sets
            .iter()
            .enumerate()
            .filter(|(_, s)| !s.corners.is_empty())
            .map(|(i, _)| i)
            .collect();
        // Three forces, the twist, the cap, then the sums of corners.
        let rows = 5 + bounded.len();
        let mut right_side = vec![0.0, 0.0, 1.0, 0.0, 1.0];
        right_side.resize(rows, 1.0);
        let (mut columns, mut owner) = (Vec::new(), Vec::new());
        for (i, set) in sets.iter().enumerate() {
            let mut add = |force: Vector3<f64>, corner: bool| {
                let (balance, place) = unit_force(&((set.position - center) / size), &force);
                let mut rows = vec![0.0; rows];
                rows[..5].copy_from_slice(&balance);
                if corner {
                    rows[5 + bounded.iter().position(|b| *b == i).unwrap_or(0)] = 1.0;
                }
                columns.push((rows, place));
                owner.push(i);
            };
            set.rays.iter().for_each(|ray| add(ray.normalize(), false));
            set.corners.iter().for_each(|corner| add(corner / weight, true));
        }
        let mut left = vec![0.0; rows];
        left[4] = 1.0;
        columns.push((left, [0.0, 0.0]));
        Balance { center, size, columns, owner, right_side }
    }

    fn program(&self) -> Tableau {
        Tableau::new(&self.right_side, &self.columns)
    }

    /// Whether forces alone carry the weight, without a look at moments.
    fn carries_the_weight(&self) -> bool {
        let without_twist = |values: &Vec<f64>| {
            let mut rows = values.clone();
            rows.remove(3);
            rows
        };
        let columns: Vec<_> =
            self.columns.iter().map(|(rows, _)| (without_twist(rows), [0.0, 0.0])).collect();
        Tableau::new(&without_twist(&self.right_side), &columns).find_feasible().is_ok()
    }

    /// In x and y of `g` (m).
    fn place(&self, at: [f64; 2]) -> Point2<f64> {
        self.center.xy() + nalgebra::Vector2::new(at[0], at[1]) * self.size
    }
}

pub(crate) fn region_of(sets: &[&ForceSet], weight: f64) -> ForceRegion {
    let balance = Balance::new(sets, weight);
    let mut program = balance.program();
    if program.find_feasible().is_err() {
        let slides = !balance.carries_the_weight();
        return ForceRegion::empty(if slides { Emptiness::Slides } else { Emptiness::Twists });
    }
    let outline = match program.clone().shadow() {
        Ok(outline) => outline,
        Err(_) => sampled(&program),
    };
    let outline = outline.iter().map(|v| (balance.place(v.at), v.loaded.as_slice()));
    outlined(outline, &balance.owner)
}

/// Vertices in some directions: a region that is no larger than the true one.
fn sampled(program: &Tableau) -> Vec<ShadowVertex> {
    let mut program = program.clone();
    (0..FALLBACK_DIRECTIONS)
        .filter_map(|i| {
            let angle = std::f64::consts::TAU * i as f64 / FALLBACK_DIRECTIONS as f64;
            program.vertex_towards([angle.cos(), angle.sin()]).ok()
        })
        .collect()
}

/// The region of an outline: its vertices (m) with the unit forces that are loaded there. `owner` is
/// the contact of each unit force; the one after the last is what is left of the cap.
pub(crate) fn outlined<'a>(
    outline: impl Iterator<Item = (Point2<f64>, &'a [usize])>,
    owner: &[usize],
) -> ForceRegion {
    let (places, loaded): (Vec<Point2<f64>>, Vec<&[usize]>) = outline.unzip();
    let capped = loaded.iter().any(|loaded| !loaded.contains(&owner.len()));
    let Some(area) = ConvexPolygon::hull(places.clone()) else {
        let middle = Point2::from(
            places.iter().map(|p| p.coords).sum::<nalgebra::Vector2<f64>>() / places.len() as f64,
        );
        let region = ConvexRegion::Point(middle);
        return ForceRegion { region, emptiness: None, bearing: Vec::new(), capped };
    };
    // Both go counter-clockwise: the next corner is looked for from the last one on.
    let mut at = 0;
    let corners: Vec<usize> = area
        .vertices()
        .iter()
        .map(|corner| {
            let on = |k: &usize| places[(at + k) % places.len()] == *corner;
            at = (at + (0..places.len()).find(on).unwrap_or(0)) % places.len();
            at
        })
        .collect();
    let bearing = (0..corners.len())
        .map(|i| {
            let ends = [corners[i], corners[(i + 1) % corners.len()]];
            let mut who = Vec::with_capacity(ends.iter().map(|end| loaded[*end].len()).sum());
            for column in ends.iter().flat_map(|end| loaded[*end]) {
                who.extend(owner.get(*column));
            }
            who.sort_unstable();
            who.dedup();
            who
        })
        .collect();
    ForceRegion { region: ConvexRegion::Area(area), emptiness: None, bearing, capped }
}
