//! Forward and inverse kinematics.

use collision::{PairDistance as Near, Touch, contact_center, survey};
use nalgebra::{Isometry3, Vector3};
use rover::{LegId, LinkId, NoSolution, Posture, Proof, Robot, Wrench, hold_torques};
use stability::loads::{compliant_share, leg_springs};
use wire::analysis::{
    InverseKinematicsAnswer, InverseKinematicsRequest, KinematicsAnswer, KinematicsRequest,
    LinkDistance, LinksWanted, PairDistance, STATES_MAX, SolutionResidual, StateKinematics,
    TARGETS_MAX, TargetSolutions, ToleranceViolation, UnreachableTarget, WheelKinematics,
    WheelTarget,
};
use wire::check::{self, At, RequestError};
use wire::convert;

use crate::scene::{Context, Scene};
use crate::stop::Stop;

/// Where everything is in each state.
pub fn kinematics(
    context: &Context,
    request: &KinematicsRequest,
    stop: &Stop,
) -> Result<KinematicsAnswer, RequestError> {
    let scene = context.scene(&At::root("scene"), &request.scene)?;
    let robot = scene.robot();
    let links = wanted_links(robot, request.links.as_ref())?;
    let Some(states) = &request.states else {
        return Ok(KinematicsAnswer {
            states: vec![of_state(&scene, &scene.configuration, &links)],
        });
    };
    let at = At::root("states");
    check::at_most(&at, states.len(), STATES_MAX)?;
    let mut answers = Vec::with_capacity(states.len());
    for (i, state) in states.iter().enumerate() {
        stop.check()?;
        let configuration = convert::configuration(&at.index(i), robot, state)?;
        answers.push(of_state(&scene, &configuration, &links));
    }
    Ok(KinematicsAnswer { states: answers })
}

fn wanted_links(
    robot: &Robot,
    wanted: Option<&LinksWanted>,
) -> Result<Option<Vec<LinkId>>, RequestError> {
    match wanted {
        None | Some(LinksWanted::All(false)) => Ok(None),
        Some(LinksWanted::All(true)) => Ok(Some((0..robot.links().len()).map(LinkId).collect())),
        Some(LinksWanted::Named(names)) => {
            let at = At::root("links");
            check::at_most(&at, names.len(), rover::MAX_LINKS)?;
            let link = |(i, name): (usize, &String)| {
                robot.link_id(name).ok_or_else(|| {
                    let name: String = name.chars().take(64).collect();
                    let text = format_args!("names the link {name:?}, which is not in the URDF");
                    RequestError::at("link_unknown", &at.index(i), text)
                })
            };
            names.iter().enumerate().map(link).collect::<Result<_, _>>().map(Some)
        }
    }
}

fn of_state(
    scene: &Scene,
    configuration: &rover::Configuration,
    links: &Option<Vec<LinkId>>,
) -> StateKinematics {
    let robot = scene.robot().as_ref();
    let posture = Posture::new(robot, configuration);
    let survey = survey(&scene.solid, &posture);
    let contacts = survey.contacts(&scene.solid, &posture);
    let com = posture.center_of_mass(robot);
    let points: Vec<_> = contacts.iter().map(|(_, point)| *point).collect();
    let springs = leg_springs(robot, &posture, &contacts);
    let loads = compliant_share(&points, &com, robot.mass() * scene.gravity, &springs);
    let wrench = |leg: LegId| {
        let i = contacts.iter().position(|(standing, _)| *standing == leg)?;
        let force = Vector3::new(0.0, 0.0, *loads.as_ref()?.get(i)?);
        Some(Wrench { point: contacts[i].1, force })
    };
    let wheel = |leg: LegId| {
        let wheel = posture.wheel(robot, leg);
        let gap = survey.wheels[leg.0].nearest;
        let contact = match &gap {
            Some(gap) => {
                let ground = contact_center(&wheel, scene.solid.map(), gap);
                // The wheel's own point: the ground's, raised by the gap.
                let on_ground = (ground - gap.ground).norm() < 1e-9;
                if on_ground { ground + Vector3::z() * gap.gap } else { ground }
            }
            None => wheel.lowest_point(&Vector3::z_axis()),
        };
        let pose = convert::pose(&wheel.world_from_wheel);
        WheelKinematics {
            position_m: pose.position_m,
            orientation_xyzw: pose.orientation_xyzw,
            contact_m: convert::point(&contact),
            gap_m: gap.map(|gap| gap.gap),
        }
    };
    let name = |link: LinkId| robot.links()[link.0].name.clone();
    let violation = |near: &Near| ToleranceViolation {
        pair: pair_names(robot, near.touch),
        distance_m: near.distance,
        tolerance_m: near.tolerance,
    };
    StateKinematics {
        com_m: convert::point(&com),
        wheels: convert::by_leg(robot, wheel),
        links: links.as_ref().map(|links| {
            links.iter().map(|link| (name(*link), convert::pose(posture.link(*link)))).collect()
        }),
        standing: survey.standing.iter().map(|leg| robot.leg(*leg).name.clone()).collect(),
        self_collision: survey.self_collision().map(|near| PairDistance {
            pair: pair_names(robot, near.touch),
            distance_m: near.distance,
        }),
        terrain_collision: survey.terrain_collision().map(|near| {
            let (link, obstacle) = match near.touch {
                Touch::Obstacle(link, index) => (link, Some(index)),
                Touch::Links(link, _) | Touch::Ground(link) | Touch::UnknownGround(link) => {
                    (link, None)
                }
            };
            LinkDistance { link: name(link), distance_m: near.distance, obstacle }
        }),
        violates_tolerance: survey.links.iter().chain(&survey.environment).map(violation).collect(),
        joint_torques_nm: convert::by_leg(robot, |leg| {
            let wrench = wrench(leg);
            let torques = hold_torques(robot, &posture, leg, scene.gravity, wrench.as_ref());
            convert::by_joint(robot.leg(leg), &torques)
        }),
    }
}

/// What touches what, by name.
fn pair_names(robot: &Robot, touch: Touch) -> [String; 2] {
    let name = |link: LinkId| robot.links()[link.0].name.clone();
    match touch {
        Touch::Links(a, b) => [name(a), name(b)],
        Touch::Ground(link) => [name(link), "terrain".into()],
        Touch::Obstacle(link, _) => [name(link), "obstacle".into()],
        Touch::UnknownGround(link) => [name(link), "unknown_terrain".into()],
    }
}

/// All branches of a leg for each wheel pose.
pub fn inverse_kinematics(
    context: &Context,
    request: &InverseKinematicsRequest,
    stop: &Stop,
) -> Result<InverseKinematicsAnswer, RequestError> {
    let scene = context.scene(&At::root("scene"), &request.scene)?;
    let robot = scene.robot().as_ref();
    let leg = convert::leg(&At::root("leg"), robot, &request.leg)?;
    let at = At::root("targets");
    check::at_most(&at, request.targets.len(), TARGETS_MAX)?;
    let base = scene.configuration.world_from_base;
    let mut targets = Vec::with_capacity(request.targets.len());
    for (i, target) in request.targets.iter().enumerate() {
        if i % 256 == 0 {
            stop.check()?;
        }
        targets.push(of_target(&at.index(i), robot, leg, &base, target)?);
    }
    Ok(InverseKinematicsAnswer { targets })
}

fn of_target(
    at: &At<'_>,
    robot: &Robot,
    leg: LegId,
    world_from_base: &Isometry3<f64>,
    target: &WheelTarget,
) -> Result<TargetSolutions, RequestError> {
    let center = check::position(&at.field("position_m"), target.position_m)?;
    let leg = robot.leg(leg);
    let base_from_world = world_from_base.inverse();
    let orients = leg.ik.fixes_orientation();
    let found = match (target.orientation_xyzw, target.axis) {
        (Some(q), None) if orients => {
            let q = check::unit_quaternion(&at.field("orientation_xyzw"), q)?;
            let world_from_wheel = Isometry3::from_parts(Vector3::from(center).into(), q);
            leg.ik.solve(leg, &(base_from_world * world_from_wheel))
        }
        (None, Some(axis)) if orients => {
            let axis = check::unit_vector(&at.field("axis"), axis)?;
            leg.ik.solve_axis(
                leg,
                &(base_from_world * nalgebra::Point3::from(center)),
                &(base_from_world.rotation * axis),
            )
        }
        (None, None) if !orients => {
            let world_from_wheel = Isometry3::from(Vector3::from(center));
            leg.ik.solve(leg, &(base_from_world * world_from_wheel))
        }
        _ if !orients => {
            let text = format_args!(
                "takes position_m alone: the leg {:?} leaves the orientation of its foot free",
                leg.name
            );
            return Err(RequestError::at("target_ambiguous", at, text));
        }
        _ => {
            let text = "takes exactly one of orientation_xyzw and axis";
            return Err(RequestError::at("target_ambiguous", at, text));
        }
    };
    let none = |nearest_m: f64, proof: Proof, reason: &str| {
        let proven = proof == Proof::Unreachable;
        let unreachable = UnreachableTarget { nearest_m, proven, reason: reason.into() };
        TargetSolutions { solutions: Vec::new(), residuals: None, unreachable: Some(unreachable) }
    };
    Ok(match found {
        Err(NoSolution { distance, proof, reason }) => none(distance, proof, reason),
        Ok(branches) => {
            let inside = || branches.iter().filter(|branch| branch.within_limits);
            let solutions: Vec<Vec<f64>> =
                inside().map(|branch| convert::by_joint(leg, &branch.angles)).collect();
            if solutions.is_empty() {
                none(0.0, Proof::Unreachable, "every branch is beyond a joint limit")
            } else {
                let residuals = inside()
                    .map(|branch| {
                        let residual = branch.residual?;
                        let (position_m, angle_rad) = (residual.position, residual.angle);
                        Some(SolutionResidual { position_m, angle_rad })
                    })
                    .collect();
                TargetSolutions { solutions, residuals, unreachable: None }
            }
        }
    })
}
