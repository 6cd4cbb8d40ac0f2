//! Stability of stances given by their contacts.

use nalgebra::{Point2, Point3};
use rover::{Posture, Robot};
use stability::contact_forces::{self, LegStatics};
use stability::energy::{EnergyMargin, TippingEdges};
use stability::force_region::{self, ForceSet};
use stability::loads::{LegSpring, compliant_share, leg_springs};
use stability::robust::{self, Uncertainty};
use stability::{ConeBound, ConeModel, Contact, ContactError, report, support_polygon};
use wire::analysis::{
    self, CASES_MAX, CONTACTS_MAX, CaseStability, EnergyEdgeAnswer, EnergySlice, EnergySurface,
    RobustAnswer, StabilityAnswer, StabilityCase, StabilityRequest, TETHERS_MAX, TorqueAnswer,
};
use wire::check::{self, At, RequestError};
use wire::convert;
use wire::live::RegionKind;

use super::regions::{emptiness_text, force_region_answer, polygon_answer, region_answer};
use crate::scene::Context;
use crate::stop::Stop;

/// Gravity where neither case nor scene says it: the Moon's (m/s²).
const GRAVITY_M_S2: f64 = 1.62;
/// Values of an energy slice.
const SLICE_VALUES: usize = 33;
/// Most nodes of an energy surface along a side.
const SURFACE_SIDE_MAX: f64 = 500.0;

/// The robot whose legs stand, where the scene tells it.
struct Model {
    robot: std::sync::Arc<Robot>,
    posture: Option<Posture>,
}

/// Polygons, margins, forces and torques of each stance.
pub fn stability(
    context: &Context,
    request: &StabilityRequest,
    stop: &Stop,
) -> Result<StabilityAnswer, RequestError> {
    let at = At::root("scene");
    let (mut gravity, mut model) = (GRAVITY_M_S2, None);
    if let Some(scene) = &request.scene {
        let robot = context.robot(&at, scene)?;
        gravity = scene.gravity_m_s2.unwrap_or(GRAVITY_M_S2);
        let state = scene.state.as_ref();
        let posture = state
            .map(|state| convert::configuration(&at.field("state"), &robot, state))
            .transpose()?
            .map(|configuration| Posture::new(&robot, &configuration));
        model = Some(Model { robot, posture });
    }
    let at = At::root("cases");
    check::at_most(&at, request.cases.len(), CASES_MAX)?;
    let mut cases = Vec::with_capacity(request.cases.len());
    for (i, case) in request.cases.iter().enumerate() {
        if i % 16 == 0 {
            stop.check()?;
        }
        cases.push(of_case(&at.index(i), case, gravity, model.as_ref())?);
    }
    Ok(StabilityAnswer { cases })
}

/// A case that has been checked.
struct Case {
    contacts: Vec<Contact>,
    points: Vec<Point3<f64>>,
    com: Point3<f64>,
    /// With a mass (N).
    weight: Option<f64>,
    tethers: Vec<ForceSet>,
    uncertainty: Option<Uncertainty>,
    /// Direction of the energy slice (rad).
    heading: Option<f64>,
    cone: ConeModel,
}

impl Case {
    fn new(at: &At<'_>, case: &StabilityCase, gravity: f64) -> Result<Case, RequestError> {
        let at_contacts = at.field("contacts");
        check::at_most(&at_contacts, case.contacts.len(), CONTACTS_MAX)?;
        let mut contacts = Vec::with_capacity(case.contacts.len());
        for (i, contact) in case.contacts.iter().enumerate() {
            let at = at_contacts.index(i);
            let position = check::position(&at.field("position_m"), contact.position_m)?;
            let normal = check::unit_vector(&at.field("normal"), contact.normal)?;
            let friction = check::within(&at.field("friction"), contact.friction, [0.0, 10.0], "")?;
            contacts.push(Contact { position: position.into(), normal, friction });
        }
        let com = Point3::from(check::position(&at.field("com_m"), case.com_m)?);
        let gravity = case.gravity_m_s2.unwrap_or(gravity);
        let gravity = check::within(&at.field("gravity_m_s2"), gravity, [0.01, 100.0], " m/s²")?;
        check::within(&at.field("cone_edges"), f64::from(case.cone_edges), [3.0, 64.0], "")?;
        let bound = match case.cone_bound {
            analysis::ConeBound::Inner => ConeBound::Inner,
            analysis::ConeBound::Outer => ConeBound::Outer,
        };
        let mut weight = None;
        if let Some(mass) = case.mass_kg {
            weight = Some(check::within(&at.field("mass_kg"), mass, [1e-6, 1e9], " kg")? * gravity);
        }
        let points = contacts.iter().map(|c| c.position).collect();
        let cone = ConeModel { edges: case.cone_edges as usize, bound };
        let yaw = at.field("energy_heading_rad");
        let heading = case.energy_heading_rad;
        let heading = heading
            .map(|yaw_rad| check::within(&yaw, yaw_rad, [-10.0, 10.0], " rad"))
            .transpose()?;
        Ok(Case {
            contacts,
            points,
            com,
            weight,
            tethers: tethers(at, case)?,
            uncertainty: uncertainty(at, case)?,
            heading,
            cone,
        })
    }

    /// What each contact, and each rope, can give.
    fn force_sets(&self) -> Result<Vec<ForceSet>, ContactError> {
        let mut sets = force_region::cones(&self.contacts, self.cone)?;
        // What a rope bears is known in shares of the weight only.
        if self.weight.is_some() {
            sets.extend(self.tethers.iter().cloned());
        }
        Ok(sets)
    }
}

fn tethers(at: &At<'_>, case: &StabilityCase) -> Result<Vec<ForceSet>, RequestError> {
    let at = at.field("tethers");
    check::at_most(&at, case.tethers.len(), TETHERS_MAX)?;
    let tether = |(i, tether): (usize, &analysis::Tether)| {
        let at = at.index(i);
        let position = check::position(&at.field("position_m"), tether.position_m)?;
        let direction = check::unit_vector(&at.field("direction"), tether.direction)?;
        let most = at.field("max_tension_n");
        let tension = check::within(&most, tether.max_tension_n, [0.0, 1e9], " N")?;
        Ok(ForceSet::tether(position.into(), direction, tension))
    };
    case.tethers.iter().enumerate().map(tether).collect()
}

fn of_case(
    at: &At<'_>,
    case: &StabilityCase,
    gravity: f64,
    model: Option<&Model>,
) -> Result<CaseStability, RequestError> {
    let request = case;
    let case = Case::new(at, request, gravity)?;
    let torque = torques(at, request, &case, model)?;
    let springs = springs(request, &case, model);
    let sets = match case.force_sets() {
        Ok(sets) => sets,
        // Everything else has been checked.
        Err(error) => return Ok(nothing(&error.to_string())),
    };
    let refused =
        |error: ContactError| RequestError::at("contacts_invalid", at, format_args!("{error}"));
    let weight = case.weight.unwrap_or(1.0);
    let friction = force_region::region(&sets, weight).map_err(refused)?;
    let lossy = force_region::conservative(&sets, weight).map_err(refused)?;
    let one = |i: usize| match i.checked_sub(case.contacts.len()) {
        None => format!("contact {i}"),
        Some(rope) => format!("tether {rope}"),
    };
    let regular = support_polygon::regular(&case.points);
    let (conservative, conservative_kind) = match support_polygon::conservative(&case.points) {
        Ok(region) => region_answer(&region, &case.points, &case.com, one),
        Err(_) => (None, RegionKind::Empty),
    };
    let why_not = match (friction.margin(&case.com), friction.emptiness) {
        (Some(margin), _) if margin >= -1e-9 => None,
        (Some(_), _) => {
            let tips = regular.as_ref().map_or(true, |hull| hull.depth_of(case.com.xy()) < 0.0);
            Some(match (&regular, tips && case.tethers.is_empty()) {
                (Err(error), _) => error.to_string(),
                (Ok(_), true) => "the center of mass is outside the support polygon".into(),
                (Ok(_), false) => "no forces within the friction cones hold the center of mass \
                                   where it is"
                    .into(),
            })
        }
        (None, why) => why.map(|why| emptiness_text(why).into()),
    };
    let energy = TippingEdges::new(&case.points).ok();
    let energy_margin = energy.as_ref().map(|edges| edges.margin(&case.com));
    let slip = contact_forces::slip_margin(&case.contacts, &case.com, case.cone);
    let friction_answer = force_region_answer(&friction, &case.com, one);
    Ok(CaseStability {
        regular: regular.ok().map(|hull| polygon_answer(&hull, &case.points, &case.com, one)),
        conservative,
        conservative_kind,
        friction: friction_answer.region,
        friction_kind: friction_answer.kind,
        friction_conservative: force_region_answer(&lossy, &case.com, one),
        torque: torque.as_ref().map(|(region, _)| region.clone()),
        least_torque: torque.and_then(|(_, least)| least),
        slip_margin: slip.map_err(refused)?,
        energy_margin_j: energy_margin.as_ref().zip(case.weight).map(|(e, w)| e.height_m * w),
        energy_margin_m: energy_margin.as_ref().map(|e| e.height_m),
        energy_edges: energy_margin.as_ref().map_or_else(Vec::new, energy_edges),
        energy_surface: surface(at, request, &case, energy.as_ref())?,
        energy_slice: slice(&case, energy.as_ref()),
        robust: robust_answer(at, &case)?,
        contact_forces_n: case
            .weight
            .and_then(|w| {
                contact_forces::least_norm(&case.contacts, &case.com, w, case.cone).ok()?
            })
            .map(|forces| forces.iter().map(|f| [f.x, f.y, f.z]).collect()),
        spring_loads_n: case
            .weight
            .and_then(|w| compliant_share(&case.points, &case.com, w, &springs)),
        stable: why_not.is_none(),
        why_not,
    })
}

/// The answer to contacts that cannot be worked with.
fn nothing(why: &str) -> CaseStability {
    CaseStability {
        regular: None,
        conservative: None,
        conservative_kind: RegionKind::Empty,
        friction: None,
        friction_kind: RegionKind::Empty,
        friction_conservative: wire::live::RegionAnswer {
            kind: RegionKind::Empty,
            region: None,
            why_empty: Some(why.into()),
            capped: false,
        },
        torque: None,
        least_torque: None,
        slip_margin: None,
        energy_margin_j: None,
        energy_margin_m: None,
        energy_edges: Vec::new(),
        energy_surface: None,
        energy_slice: None,
        robust: None,
        contact_forces_n: None,
        spring_loads_n: None,
        stable: false,
        why_not: Some(why.into()),
    }
}

/// The springs of the legs that the contacts name, where scene and case tell their posture; else equal ones.
fn springs(request: &StabilityCase, case: &Case, model: Option<&Model>) -> Vec<LegSpring> {
    let own = || {
        let Model { robot, posture: Some(posture) } = model? else { return None };
        let foot = |(contact, point): (&analysis::StanceContact, &Point3<f64>)| {
            let leg = robot.leg_ids().find(|l| Some(&robot.leg(*l).name) == contact.leg.as_ref());
            Some((leg?, *point))
        };
        let feet = request.contacts.iter().zip(&case.points).map(foot);
        Some(leg_springs(robot, posture, &feet.collect::<Option<Vec<_>>>()?))
    };
    let even = LegSpring { stiffness_n_m: 1.0, pressed_m: 0.0 };
    own().unwrap_or_else(|| vec![even; case.points.len()])
}

type Torques = (wire::live::RegionAnswer, Option<TorqueAnswer>);

/// Torques, where every contact names its leg and scene and case tell the rest.
fn torques(
    at: &At<'_>,
    request: &StabilityCase,
    case: &Case,
    model: Option<&Model>,
) -> Result<Option<Torques>, RequestError> {
    let at = at.field("contacts");
    let mut legs = Vec::new();
    for (i, contact) in request.contacts.iter().enumerate() {
        let (Some(name), Some(Model { robot, posture })) = (&contact.leg, model) else { continue };
        let leg = convert::leg(&at.index(i).field("leg"), robot, name)?;
        if let (Some(posture), Some(weight)) = (posture, case.weight) {
            let gravity = weight / request.mass_kg.unwrap_or(1.0);
            legs.push(LegStatics::new(robot, posture, leg, &case.points[i], gravity));
        }
    }
    let Some((weight, model)) = case.weight.zip(model) else { return Ok(None) };
    if legs.is_empty() || legs.len() != case.contacts.len() {
        return Ok(None);
    }
    let refused =
        |error: ContactError| RequestError::at("contacts_invalid", &at, format_args!("{error}"));
    let region =
        report::torque_region(&legs, &case.contacts, weight, case.cone).map_err(refused)?;
    let named = |i: usize| request.contacts[i].leg.clone().unwrap_or_default();
    let least = contact_forces::least_torque(&legs, &case.contacts, &case.com, weight, case.cone)
        .map_err(refused)?;
    let least = least.map(|least| {
        let (leg, place) = least.joint;
        let joint = model.robot.leg(legs[leg].leg).joints[place];
        TorqueAnswer {
            ratio: least.ratio,
            joint: model.robot.joints()[joint].name.clone(),
            forces_n: least.forces.iter().map(|f| [f.x, f.y, f.z]).collect(),
        }
    });
    Ok(Some((force_region_answer(&region, &case.com, named), least)))
}

fn energy_edges(margin: &EnergyMargin) -> Vec<EnergyEdgeAnswer> {
    let edge = |e: &stability::energy::EnergyEdge| EnergyEdgeAnswer {
        contacts: e.contacts,
        height_m: e.height_m,
    };
    margin.edges.iter().map(edge).collect()
}

fn extent(edges: &TippingEdges) -> (Point2<f64>, Point2<f64>) {
    let vertices = edges.polygon().vertices();
    let fold = |pick: fn(f64, f64) -> f64| {
        vertices
            .iter()
            .skip(1)
            .fold(vertices[0], |a, b| Point2::new(pick(a.x, b.x), pick(a.y, b.y)))
    };
    (fold(f64::min), fold(f64::max))
}

fn surface(
    at: &At<'_>,
    request: &StabilityCase,
    case: &Case,
    edges: Option<&TippingEdges>,
) -> Result<Option<EnergySurface>, RequestError> {
    let Some((resolution, edges)) = request.energy_surface_m.zip(edges) else { return Ok(None) };
    let (low, high) = extent(edges);
    let most = (high - low).amax();
    let range = [most / SURFACE_SIDE_MAX, 1e6];
    check::within(&at.field("energy_surface_m"), resolution, range, " m")?;
    let n = |length: f64| (length / resolution).floor() as usize + 1;
    let grid =
        geometry::Grid { origin: low, resolution, nx: n(high.x - low.x), ny: n(high.y - low.y) };
    let heights: Vec<f32> =
        edges.surface(&grid, case.com.z).into_iter().map(|h| h as f32).collect();
    Ok(Some(EnergySurface {
        origin_m: [low.x, low.y],
        resolution_m: resolution,
        size: [grid.nx, grid.ny],
        height_m: analysis::base64_f32(&heights),
    }))
}

fn slice(case: &Case, edges: Option<&TippingEdges>) -> Option<EnergySlice> {
    let (heading, edges) = case.heading.zip(edges)?;
    let (low, high) = extent(edges);
    let length_m = (high - low).norm();
    let height_m = edges.slice(&case.com, heading, length_m, SLICE_VALUES);
    Some(EnergySlice { length_m, height_m })
}

fn uncertainty(at: &At<'_>, case: &StabilityCase) -> Result<Option<Uncertainty>, RequestError> {
    let Some(asked) = &case.uncertainty else { return Ok(None) };
    let at = at.field("uncertainty");
    let height_m = check::within(&at.field("height_m"), asked.height_m, [0.0, 10.0], " m")?;
    let angle = at.field("normal_rad");
    let normal_rad = check::within(&angle, asked.normal_rad, [0.0, 1.5], " rad")?;
    let friction = check::within(&at.field("friction"), asked.friction, [0.0, 10.0], "")?;
    Ok(Some(Uncertainty { height_m, normal_rad, friction }))
}

fn robust_answer(at: &At<'_>, case: &Case) -> Result<Option<RobustAnswer>, RequestError> {
    let Some(uncertainty) = &case.uncertainty else { return Ok(None) };
    let least = robust::margins(&case.contacts, &case.com, uncertainty, case.cone)
        .map_err(|error| RequestError::at("contacts_invalid", at, format_args!("{error}")))?;
    Ok(Some(RobustAnswer { friction_margin_m: least.friction_m, energy_margin_m: least.energy_m }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::analysis::StanceContact;

    fn hexagon(normal: [f64; 3]) -> StabilityCase {
        let contact = |i: u32| {
            let yaw = std::f64::consts::TAU * f64::from(i) / 6.0;
            StanceContact {
                position_m: [yaw.cos(), yaw.sin(), 0.0],
                normal,
                friction: 0.7,
                leg: None,
            }
        };
        StabilityCase {
            contacts: (0..6).map(contact).collect(),
            com_m: [0.0, 0.0, 1.0],
            mass_kg: Some(600.0),
            gravity_m_s2: Some(1.0),
            cone_edges: 8,
            cone_bound: analysis::ConeBound::Inner,
            tethers: Vec::new(),
            uncertainty: None,
            energy_surface_m: None,
            energy_heading_rad: None,
        }
    }

    fn answer(case: StabilityCase) -> CaseStability {
        of_case(&At::root("case"), &case, GRAVITY_M_S2, None).unwrap()
    }

    #[test]
    fn a_hexagon_has_its_apothem_as_margin_and_shares_the_weight() {
        let case = answer(hexagon([0.0, 0.0, 1.0]));
        assert!((case.regular.unwrap().margin_m - 0.75_f64.sqrt()).abs() < 1e-12);
        assert!((case.conservative.unwrap().margin_m - 0.5).abs() < 1e-12);
        assert!(case.contact_forces_n.unwrap().iter().all(|f| (f[2] - 100.0).abs() < 1e-9));
        assert!(case.stable && case.why_not.is_none());
    }

    #[test]
    fn ground_steeper_than_its_friction_is_not_called_stable() {
        let tilt: f64 = 0.7_f64.atan() + 0.01;
        let case = answer(hexagon([tilt.sin(), 0.0, tilt.cos()]));
        assert!(!case.stable && case.why_not.unwrap().contains("too steep"));
        assert_eq!(case.friction_kind, RegionKind::Empty);
    }

    #[test]
    fn four_feet_leave_a_point_and_three_nothing() {
        let mut case = hexagon([0.0, 0.0, 1.0]);
        case.contacts.truncate(4);
        let four = answer(case.clone());
        assert_eq!(four.conservative_kind, RegionKind::Point);
        assert_eq!(four.conservative.unwrap().polygon_m.len(), 1);
        case.contacts.truncate(3);
        assert_eq!(answer(case).conservative_kind, RegionKind::Empty);
    }
}
