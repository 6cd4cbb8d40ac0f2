//! What is derived from each telemetry frame, live and in a replay alike (F14).

use nalgebra::{Point3, Unit, Vector3};
use rover::{LegId, Posture, Robot, WheelPose};
use stability::{ConeModel, Contact, ForceRegion, ForceReport, StanceReport};
use wire::check::At;
use wire::convert;
use wire::live::{ForcesDerived, RegionKind, RoverTelemetry, StabilityDerived};

use super::regions::{self, polygon_answer, region_answer};

/// Where a rover stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Site {
    /// Gravity (m/s²).
    pub gravity: f64,
    /// Friction between wheel and ground.
    pub friction: f64,
}

/// What the ground derives from a telemetry frame of `robot`; `None` for a frame of another robot.
pub fn derive(robot: &Robot, site: &Site, frame: &RoverTelemetry) -> Option<StabilityDerived> {
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
    let report = stability::assess(robot, &posture, &standing, site.gravity);
    let contacts: Vec<(LegId, Contact)> = standing
        .iter()
        .map(|(leg, position)| {
            let normal = normal_at(&posture.wheel(robot, *leg), position);
            (*leg, Contact { position: *position, normal, friction: site.friction })
        })
        .collect();
    // Frames whose contacts are no numbers have no forces; all else of them is still told.
    let forces =
        stability::report::forces(robot, &posture, &contacts, site.gravity, ConeModel::default());
    let forces = forces.ok().map(|forces| forces_derived(robot, &forces, site, frame));
    Some(StabilityDerived { forces, ..derived(robot, &report, frame) })
}

/// The ground's normal as a wheel shows it: from where it touches to its center, in the wheel's
/// plane. It needs no map, so a replay derives the same; a camber of the wheel is not seen.
fn normal_at(wheel: &WheelPose, contact: &Point3<f64>) -> Unit<Vector3<f64>> {
    let axle = wheel.world_from_wheel.rotation * Vector3::y();
    let out = wheel.center() - contact;
    let in_plane = if wheel.width > 0.0 { out - axle * axle.dot(&out) } else { out };
    Unit::try_new(in_plane, 1e-6).filter(|n| n.z > 0.0).unwrap_or_else(Vector3::z_axis)
}

fn forces_derived(
    robot: &Robot,
    report: &ForceReport,
    site: &Site,
    frame: &RoverTelemetry,
) -> ForcesDerived {
    let leg = |i: usize| robot.leg(report.standing[i]);
    let name = |i: usize| leg(i).name.clone();
    let joint = |(i, place): (usize, usize)| {
        leg(i).joints.get(place).map(|j| robot.joints()[*j].name.clone()).unwrap_or_default()
    };
    let region = |found: &ForceRegion| regions::force_region_answer(found, &report.com, name);
    let by_leg = |values: Vec<[f64; 3]>| {
        values.into_iter().enumerate().map(|(i, value)| (name(i), value)).collect()
    };
    let energy = report.energy.as_ref().ok();
    ForcesDerived {
        friction_coefficient: site.friction,
        friction: region(&report.friction),
        friction_conservative: region(&report.friction_conservative),
        torque: region(&report.torque),
        slip_margin: report.slip_margin,
        energy_margin_m: energy.map(|e| e.height_m),
        energy_margin_j: energy.map(|e| e.height_m * report.weight),
        energy_edge: energy.map(|e| e.edges[e.critical].contacts.map(name)),
        contact_forces_n: report
            .least_norm
            .as_ref()
            .map(|forces| by_leg(forces.iter().map(|f| [f.x, f.y, f.z]).collect())),
        least_torque_ratio: report.least_torque.as_ref().map(|t| t.ratio),
        least_torque_joint: report.least_torque.as_ref().map(|t| joint(t.joint)),
        load_share_n: report.load_band.as_ref().map(|band| {
            let ends = band.least_n.iter().zip(&band.expected_n).zip(&band.most_n);
            by_leg(ends.map(|((least, expected), most)| [*least, *expected, *most]).collect())
        }),
        load_torque_ratio: report.load_torque.map(|(ratio, _)| ratio),
        load_torque_joint: report.load_torque.map(|(_, at)| joint(at)),
        torque_safe: report.is_torque_safe(),
        center_of_force_m: center_of_force(frame),
    }
}

/// Where the measured vertical forces on the wheels act together (A24).
fn center_of_force(frame: &RoverTelemetry) -> Option<[f64; 2]> {
    let loads = frame.wheel_forces_n.iter().filter_map(|(leg, force)| {
        let at = frame.contact_points_m.get(leg)?;
        let bears = *frame.contacts.get(leg)? && force[2] > 0.0;
        bears.then_some((at, force[2]))
    });
    let (mut sum, mut moment) = (0.0, [0.0, 0.0]);
    for (at, load) in loads {
        sum += load;
        moment = [moment[0] + at[0] * load, moment[1] + at[1] * load];
    }
    (sum > 0.0).then(|| moment.map(|m| m / sum))
}

fn derived(robot: &Robot, report: &StanceReport, frame: &RoverTelemetry) -> StabilityDerived {
    let leg_name = |leg: LegId| robot.leg(leg).name.clone();
    let named = |i: usize| leg_name(report.standing[i]);
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
        forces: None,
    }
}
