//! Stability of stances, and what is derived from each telemetry frame.

use geometry::{ConvexPolygon, ConvexRegion};
use nalgebra::{Point2, Point3};
use rover::{LegId, Posture, Robot};
use stability::support_polygon;
use stability::{StanceReport, spring_share};
use wire::analysis::{
    CASES_MAX, CONTACTS_MAX, CaseStability, StabilityAnswer, StabilityCase, StabilityRequest,
};
use wire::check::{self, At, RequestError};
use wire::convert;
use wire::live::{PolygonAnswer, RegionKind, RoverTelemetry, StabilityDerived};

use crate::scene::Context;
use crate::stop::Stop;

/// Gravity where neither case nor scene says it: the Moon's (m/s²).
const GRAVITY_M_S2: f64 = 1.62;

/// Polygons, margins and loads of each stance.
pub fn stability(
    context: &Context,
    request: &StabilityRequest,
    stop: &Stop,
) -> Result<StabilityAnswer, RequestError> {
    let at = At::root("scene");
    let gravity = match &request.scene {
        Some(scene) => {
            // What the scene says of the robot is checked, although only gravity is used so far.
            context.robot(&at, scene)?;
            scene.gravity_m_s2.unwrap_or(GRAVITY_M_S2)
        }
        None => GRAVITY_M_S2,
    };
    let at = At::root("cases");
    check::at_most(&at, request.cases.len(), CASES_MAX)?;
    let mut cases = Vec::with_capacity(request.cases.len());
    for (i, case) in request.cases.iter().enumerate() {
        if i % 64 == 0 {
            stop.check()?;
        }
        cases.push(of_case(&at.index(i), case, gravity)?);
    }
    Ok(StabilityAnswer { cases })
}

fn of_case(at: &At<'_>, case: &StabilityCase, gravity: f64) -> Result<CaseStability, RequestError> {
    let at_contacts = at.field("contacts");
    check::at_most(&at_contacts, case.contacts.len(), CONTACTS_MAX)?;
    let (mut points, mut inclinations) = (Vec::new(), Vec::new());
    for (i, contact) in case.contacts.iter().enumerate() {
        let at = at_contacts.index(i);
        points.push(Point3::from(check::position(&at.field("position_m"), contact.position_m)?));
        let normal = check::unit_vector(&at.field("normal"), contact.normal)?;
        let friction = check::within(&at.field("friction"), contact.friction, [0.0, 10.0], "")?;
        inclinations.push((normal.z.clamp(-1.0, 1.0).acos(), friction.atan()));
    }
    let com = Point3::from(check::position(&at.field("com_m"), case.com_m)?);
    let gravity = case.gravity_m_s2.unwrap_or(gravity);
    let gravity = check::within(&at.field("gravity_m_s2"), gravity, [0.01, 100.0], " m/s²")?;
    check::within(&at.field("cone_edges"), f64::from(case.cone_edges), [3.0, 64.0], "")?;
    if let Some(mass) = case.mass_kg {
        check::within(&at.field("mass_kg"), mass, [1e-6, 1e9], " kg")?;
    }
    let named = |pair: [usize; 2]| format!("contacts {} and {}", pair[0], pair[1]);
    let regular = support_polygon::regular(&points);
    let (conservative, conservative_kind) = match support_polygon::conservative(&points) {
        Ok(region) => region_answer(&region, &points, &com, named),
        Err(_) => (None, RegionKind::Empty),
    };
    // The share of the loads does not depend on the weight.
    let shares = spring_share(&points, &com, 1.0);
    let why_not = match (&regular, &shares) {
        (Err(error), _) => Some(error.to_string()),
        (Ok(_), None) => Some("the center of mass is outside the support polygon".into()),
        (Ok(_), Some(shares)) => slipping(shares, &inclinations),
    };
    let regular = regular.ok().map(|polygon| polygon_answer(&polygon, &points, &com, named));
    let contact_forces_n = shares.zip(case.mass_kg).map(|(shares, mass)| {
        shares.iter().map(|share| [0.0, 0.0, share * mass * gravity]).collect()
    });
    Ok(CaseStability {
        regular,
        conservative,
        conservative_kind,
        friction: None,
        torque: None,
        energy_margin_j: None,
        energy_margin_m: None,
        contact_forces_n,
        stable: why_not.is_none(),
        why_not,
    })
}

/// The loaded contact that vertical forces are not within the friction cone of.
fn slipping(shares: &[f64], inclinations: &[(f64, f64)]) -> Option<String> {
    shares.iter().zip(inclinations).enumerate().find_map(|(i, (share, (tilt, cone)))| {
        (*share > 1e-12 && *tilt > cone + 1e-12).then(|| {
            format!(
                "contact {i} stands on ground inclined by {tilt:.3} rad, beyond its friction angle \
                 of {cone:.3} rad, so vertical forces do not hold it; whether others would is not \
                 computed by this version"
            )
        })
    })
}

fn polygon_answer(
    polygon: &ConvexPolygon,
    contacts: &[Point3<f64>],
    com: &Point3<f64>,
    named: impl Fn([usize; 2]) -> String,
) -> PolygonAnswer {
    let margin = support_polygon::margin(polygon, contacts, com);
    let edge = polygon.edges().nth(margin.edge);
    PolygonAnswer {
        polygon_m: polygon.vertices().iter().map(plain).collect(),
        area_m2: polygon.area(),
        margin_m: margin.depth_m,
        critical_edge_m: edge.map(|(a, b)| [plain(&a), plain(&b)]),
        critical: Some(named(margin.contacts)),
    }
}

fn region_answer(
    region: &ConvexRegion,
    contacts: &[Point3<f64>],
    com: &Point3<f64>,
    named: impl Fn([usize; 2]) -> String,
) -> (Option<PolygonAnswer>, RegionKind) {
    match region {
        ConvexRegion::Area(polygon) => {
            (Some(polygon_answer(polygon, contacts, com, named)), RegionKind::Area)
        }
        ConvexRegion::Point(point) => {
            let answer = PolygonAnswer {
                polygon_m: vec![plain(point)],
                area_m2: 0.0,
                margin_m: -(com.xy() - point).norm(),
                critical_edge_m: None,
                critical: None,
            };
            (Some(answer), RegionKind::Point)
        }
        ConvexRegion::Empty => (None, RegionKind::Empty),
    }
}

fn plain(p: &Point2<f64>) -> [f64; 2] {
    [p.x, p.y]
}

/// What the ground derives from a telemetry frame of `robot`; `None` for a frame of another robot.
pub fn derive(robot: &Robot, gravity: f64, frame: &RoverTelemetry) -> Option<StabilityDerived> {
    let at = At::root("state");
    let configuration = convert::configuration(&at, robot, &frame.state).ok()?;
    let posture = Posture::new(robot, &configuration);
    let standing: Vec<(LegId, Point3<f64>)> = robot
        .leg_ids()
        .filter_map(|leg| {
            let name = &robot.leg(leg).name;
            let stands = *frame.contacts.get(name)?;
            stands.then(|| Some((leg, Point3::from(*frame.contact_points_m.get(name)?))))?
        })
        .collect();
    let report = stability::assess(robot, &posture, &standing, gravity);
    Some(derived(robot, &report, frame))
}

fn derived(robot: &Robot, report: &StanceReport, frame: &RoverTelemetry) -> StabilityDerived {
    let leg_name = |leg: LegId| robot.leg(leg).name.clone();
    let named = |pair: [usize; 2]| {
        format!("{} and {}", leg_name(report.standing[pair[0]]), leg_name(report.standing[pair[1]]))
    };
    let regular = report
        .regular
        .as_ref()
        .ok()
        .map(|support| polygon_answer(&support.polygon, &report.contacts, &report.com, named));
    let (conservative, conservative_kind) = match &report.conservative {
        Some(support) => region_answer(&support.region, &report.contacts, &report.com, named),
        None => (None, RegionKind::Empty),
    };
    // The torques that the rover reports, not those that a model would need.
    let ratio = |leg: LegId| -> Vec<f64> {
        let leg = robot.leg(leg);
        let Some(torques) = frame.joint_torques_nm.get(&leg.name) else {
            return vec![0.0; leg.n_joints()];
        };
        torques
            .iter()
            .zip(leg.effort.iter())
            .map(|(torque, limit)| if *limit > 0.0 { torque / limit } else { 0.0 })
            .collect()
    };
    let torque_ratios = convert::by_leg(robot, ratio);
    let worst = robot
        .leg_ids()
        .flat_map(|leg| {
            let ratios = ratio(leg);
            ratios.into_iter().enumerate().map(move |(place, ratio)| (leg, place, ratio.abs()))
        })
        .max_by(|a, b| a.2.total_cmp(&b.2));
    let worst_joint = worst.map(|(leg, place, _)| {
        let joint = robot.leg(leg).joints.get(place).map(|j| robot.joints()[*j].name.clone());
        joint.unwrap_or_default()
    });
    StabilityDerived {
        com_m: convert::point(&report.com),
        regular,
        conservative,
        conservative_kind,
        settlement_margin_m: report
            .settlement
            .as_ref()
            .map(|settlement| settlement.margin_m)
            .filter(|margin| margin.is_finite()),
        settlement_leg: report.settlement.as_ref().map(|settlement| leg_name(settlement.leg)),
        torque_ratio: worst.map_or(0.0, |(_, _, ratio)| ratio),
        torque_joint: worst_joint.unwrap_or_default(),
        torque_ratios,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::analysis::StanceContact;

    fn hexagon(normal: [f64; 3]) -> StabilityCase {
        let contact = |i: u32| {
            let yaw = std::f64::consts::TAU * f64::from(i) / 6.0;
            StanceContact { position_m: [yaw.cos(), yaw.sin(), 0.0], normal, friction: 0.7 }
        };
        StabilityCase {
            contacts: (0..6).map(contact).collect(),
            com_m: [0.0, 0.0, 1.0],
            mass_kg: Some(600.0),
            gravity_m_s2: Some(1.0),
            cone_edges: 8,
        }
    }

    fn answer(case: StabilityCase) -> CaseStability {
        of_case(&At::root("case"), &case, GRAVITY_M_S2).unwrap()
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
        assert!(!case.stable && case.why_not.unwrap().contains("contact 0"));
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
