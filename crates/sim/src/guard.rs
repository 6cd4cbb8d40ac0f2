//! What the rover watches while it moves, and predicts before it does.

use collision::{ContactZone, LegChecker, Scene, Survey, Touch, survey};
use geometry::ConvexPolygon;
use rover::{LegAngles, LegId, LinkId, Posture, Robot};
use stability::support_polygon;

use crate::closure::{Closure, Fit, slip_max};
use crate::command::names;
use crate::path::TimedPath;
use crate::refusal::Refusal;
use crate::stand::{Foot, foot, names_without, standing, support_without};

/// Largest change of a joint between two looks (rad): some 5 mm of the wheel at full reach.
pub(crate) const LOOK: f64 = 0.002;

/// Largest change of a joint between two looks of the prediction (rad) ...
const LOOK_AHEAD: f64 = 0.05;
/// ... most looks of it, however long the path (at least one a piece) ...
const LOOKS_AHEAD_MAX: usize = 20_000;
/// ... and least looks at a piece of a body path: slip is worst between knots.
const BODY_LOOKS: usize = 4;

/// Why the rover stopped itself. The leg is where all was still well.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // each variant is its message
pub enum Fault {
    #[error("{leg}'s wheel met the ground {from_goal:.2} m before its goal")]
    WheelMetGround { leg: String, from_goal: f64 },
    #[error("{link} met {what}, with the wheel {from_goal:.2} m before its goal")]
    LinkMet { link: String, what: String, from_goal: f64 },
    #[error("{link} came over unknown ground, with the wheel {from_goal:.2} m before its goal")]
    UnknownGround { link: String, from_goal: f64 },
    #[error(
        "{leg} is off the ground and the center of mass would come {outside:.3} m outside the support of {standing}"
    )]
    Unsupported { leg: String, standing: String, outside: f64 },
    #[error("nothing was heard from the ground for {silence_s} s: the rover holds")]
    GroundSilent { silence_s: f64 },
    #[error("{leg} would leave the ground with fewer than 3 other wheels standing")]
    TooFewFeet { leg: String },
    #[error(
        "{leg}'s wheel would slip by {slip:.4} m, more than {most:.4} m, while the body shifts"
    )]
    Slip { leg: String, slip: f64, most: f64 },
    #[error("{leg}'s wheel would leave the ground while the body shifts")]
    LeftGround { leg: String },
    #[error("{link} met {what} while the body shifted")]
    BodyMet { link: String, what: String },
    #[error(
        "the center of mass would come {outside:.3} m outside the support of {standing} while the body shifts"
    )]
    BodyUnsupported { outside: f64, standing: String },
    #[error("{link} met {what} while the wheels rolled")]
    DriveMet { link: String, what: String },
    #[error("{leg}'s wheel would leave the ground while the wheels roll")]
    DriveLeftGround { leg: String },
    #[error("the center of mass would come {outside:.3} m outside the support of the wheels")]
    DriveUnsupported { outside: f64 },
}

/// Refuses a path on which the rover would tip over: somewhere the leg is off the ground and the
/// center of mass is outside the support of the others.
///
/// The path is looked at every 0.05 rad of joint motion; the guard looks closer when it comes.
pub(crate) fn predict_support(
    scene: &Scene,
    posture: &Posture,
    feet: &[Foot],
    leg: LegId,
    path: &TimedPath,
) -> Result<(), Refusal> {
    let robot = scene.robot();
    let balance = Balance::new(feet, leg);
    let mut moved = posture.clone();
    for (_, angles) in path.looks(LOOK_AHEAD, 1, most_looks(path)) {
        moved.move_leg(robot, leg, &angles[0]);
        if let Err(outside) = balance.holds(scene, &moved, feet) {
            let name = robot.leg(leg).name.clone();
            return Err(match outside {
                Some(outside) => Refusal::Unsupported {
                    leg: name,
                    standing: names_without(scene, feet, leg),
                    outside,
                },
                None => Refusal::TooFewFeet { leg: name, n_standing: balance.n_others },
            });
        }
    }
    Ok(())
}

/// Most looks at each piece of a path.
fn most_looks(path: &TimedPath) -> usize {
    (LOOKS_AHEAD_MAX / path.n_pieces().max(1)).max(BODY_LOOKS)
}

/// Refuses a body path on which a wheel would slip, or the center of mass leave the support of the
/// standing legs. `legs` are the angles of all legs now.
pub(crate) fn predict_shift(
    scene: &Scene,
    closure: &Closure,
    feet: &[Foot],
    legs: &[LegAngles],
    path: &TimedPath,
) -> Result<(), Refusal> {
    let robot = scene.robot();
    let all: Vec<LegId> = closure.legs().collect();
    let contacts: Vec<_> = all.iter().map(|leg| feet[leg.0].point).collect();
    let support = support_polygon::regular(&contacts).ok();
    let most = slip_max(robot);
    for (at_s, angles) in path.looks(LOOK_AHEAD, BODY_LOOKS, most_looks(path)) {
        let fit = closure.fit(robot, path.applied(legs, &angles));
        if fit.slip > most {
            let leg = robot.leg(fit.leg).name.clone();
            return Err(Refusal::Slip { at_s, leg, slip: fit.slip, most });
        }
        let com = fit.posture.center_of_mass(robot);
        let depth = support.as_ref().map_or(f64::NEG_INFINITY, |s| s.depth_of(com.xy()));
        if depth < 0.0 {
            let standing = names(robot, &all);
            return Err(Refusal::BodyUnsupported { at_s, outside: -depth, standing });
        }
    }
    Ok(())
}

/// What is wrong with the body in the midst of a shift, if anything: slip, a wheel off the ground,
/// the center of mass, any part that touches what it should not.
pub(crate) fn look_at_shift(scene: &Scene, closure: &Closure, fit: &Fit) -> Option<Fault> {
    let robot = scene.robot();
    let name = |leg: LegId| robot.leg(leg).name.clone();
    let most = slip_max(robot);
    if fit.slip > most {
        return Some(Fault::Slip { leg: name(fit.leg), slip: fit.slip, most });
    }
    let seen = survey(scene, &fit.posture);
    if let Some(pair) = seen.self_collision().or(seen.terrain_collision()) {
        let (link, what) = touched(robot, pair.touch);
        return Some(Fault::BodyMet { link, what });
    }
    if let Some(leg) = closure.legs().find(|leg| !seen.standing.contains(leg)) {
        return Some(Fault::LeftGround { leg: name(leg) });
    }
    let hangs = |leg: &LegId| !closure.legs().any(|other| other == *leg);
    if let Some(leg) = robot.leg_ids().filter(hangs).find(|leg| seen.wheels[leg.0].unknown) {
        let link = robot.links()[robot.leg(leg).wheel_link.0].name.clone();
        return Some(Fault::BodyMet { link, what: "unknown ground".into() });
    }
    let (legs, contacts): (Vec<LegId>, Vec<_>) =
        seen.contacts(scene, &fit.posture).into_iter().unzip();
    let com = fit.posture.center_of_mass(robot);
    let depth = support_polygon::regular(&contacts)
        .map_or(f64::NEG_INFINITY, |support| support.depth_of(com.xy()));
    let standing = || names(robot, &legs);
    (depth < 0.0).then(|| Fault::BodyUnsupported { outside: -depth, standing: standing() })
}

/// What is wrong with the rover while its wheels are steered or driven, if anything: what touches, a
/// wheel off the ground or over ground that is unknown, the center of mass.
pub(crate) fn look_at_rolling(scene: &Scene, posture: &Posture, seen: &Survey) -> Option<Fault> {
    let robot = scene.robot();
    if let Some(pair) = seen.self_collision().or(seen.terrain_collision()) {
        let (link, what) = touched(robot, pair.touch);
        return Some(Fault::DriveMet { link, what });
    }
    let name = |leg: LegId| robot.leg(leg).name.clone();
    if let Some(leg) = robot.leg_ids().find(|leg| !seen.standing.contains(leg)) {
        return Some(Fault::DriveLeftGround { leg: name(leg) });
    }
    let contacts: Vec<_> = seen.contacts(scene, posture).into_iter().map(|(_, at)| at).collect();
    let com = posture.center_of_mass(robot);
    let depth = support_polygon::regular(&contacts)
        .map_or(f64::NEG_INFINITY, |support| support.depth_of(com.xy()));
    (depth < 0.0).then_some(Fault::DriveUnsupported { outside: -depth })
}

/// Whether the rover stands while one leg moves.
struct Balance {
    leg: LegId,
    n_others: usize,
    /// Support of the legs that do not move.
    others: Option<ConvexPolygon>,
}

impl Balance {
    fn new(feet: &[Foot], leg: LegId) -> Balance {
        let n_others = standing(feet).iter().filter(|(other, _)| *other != leg).count();
        Balance { leg, n_others, others: support_without(feet, leg) }
    }

    /// `Err` if the rover tips over in `posture`, with how far the center of mass is outside (m),
    /// or `None` if the other legs have no support at all.
    fn holds(&self, scene: &Scene, posture: &Posture, feet: &[Foot]) -> Result<(), Option<f64>> {
        let com = posture.center_of_mass(scene.robot());
        let depth = self.others.as_ref().map(|others| others.depth_of(com.xy()));
        if depth.is_some_and(|depth| depth >= 0.0) {
            return Ok(());
        }
        // The moving leg bears too as long as its wheel stands.
        let moving = foot(scene, posture, self.leg);
        let mut feet = feet.to_vec();
        feet[self.leg.0] = moving;
        let contacts: Vec<_> = standing(&feet).into_iter().map(|(_, contact)| contact).collect();
        let all = support_polygon::regular(&contacts).ok();
        if moving.stands && all.is_some_and(|all| all.depth_of(com.xy()) >= 0.0) {
            return Ok(());
        }
        Err(depth.map(|depth| -depth))
    }
}

/// Watches one leg that moves while the rest of the robot stands.
pub(crate) struct Guard<'a> {
    scene: &'a Scene,
    feet: &'a [Foot],
    checker: LegChecker<'a>,
    balance: Balance,
    zone: ContactZone,
    goal: Posture,
}

impl<'a> Guard<'a> {
    /// A guard for `leg` on its way to the angles `goal`, with the robot as in `posture`.
    pub fn new(
        scene: &'a Scene,
        posture: &Posture,
        feet: &'a [Foot],
        leg: LegId,
        goal: &LegAngles,
    ) -> Guard<'a> {
        // The wheel may touch ground anywhere, as deep as a standing wheel may be.
        let zone = ContactZone {
            contact: feet[leg.0].point,
            center: posture.wheel(scene.robot(), leg).center(),
            radius: f64::INFINITY,
            height: f64::INFINITY,
            ground_tolerance: scene.robot().stance().ground_tolerance,
        };
        Guard {
            scene,
            feet,
            checker: LegChecker::new(scene, posture, leg, None, None),
            balance: Balance::new(feet, leg),
            zone,
            goal: posture.with_leg(scene.robot(), leg, goal),
        }
    }

    /// What is wrong with the leg as in `posture`, if anything.
    pub fn look(&self, posture: &Posture) -> Option<Fault> {
        let robot = self.scene.robot();
        let leg = self.checker.leg();
        if let Some(touch) =
            self.checker.collision(posture, Some(&self.zone)).map(|found| found.touch)
        {
            let wheel = |posture: &Posture| posture.wheel(robot, leg).center();
            let from_goal = (wheel(&self.goal) - wheel(posture)).norm();
            let (link, what) = touched(robot, touch);
            let wheel_link = robot.leg(leg).wheel_link;
            return Some(match touch {
                Touch::Ground(part) if part == wheel_link => {
                    Fault::WheelMetGround { leg: robot.leg(leg).name.clone(), from_goal }
                }
                Touch::UnknownGround(_) => Fault::UnknownGround { link, from_goal },
                _ => Fault::LinkMet { link, what, from_goal },
            });
        }
        let name = robot.leg(leg).name.clone();
        match self.balance.holds(self.scene, posture, self.feet) {
            Ok(()) => None,
            Err(Some(outside)) => Some(Fault::Unsupported {
                leg: name,
                standing: names_without(self.scene, self.feet, leg),
                outside,
            }),
            Err(None) => Some(Fault::TooFewFeet { leg: name }),
        }
    }
}

/// The link that touches, and what it touches, by name.
pub(crate) fn touched(robot: &Robot, touch: Touch) -> (String, String) {
    let name = |link: LinkId| robot.links()[link.0].name.clone();
    match touch {
        Touch::Links(a, b) => (name(a), name(b)),
        Touch::Ground(link) => (name(link), "the ground".into()),
        Touch::Obstacle(link, index) => (name(link), format!("obstacle {index}")),
        Touch::UnknownGround(link) => (name(link), "unknown ground".into()),
    }
}
