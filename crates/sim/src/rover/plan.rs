//! From a motion to its phases, checked: what would not be begun is refused here.

use std::collections::VecDeque;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rover::{LegAngles, LegId};

use super::SimRover;
use crate::arc::Ramped;
use crate::closure::Closure;
use crate::command::{
    BODY_KNOTS_MAX, BodyKnot, DriveArc, GoalFrame, KNOTS_MAX, Motion, Operating, STEPS_MAX, Step,
    WheelHold, body_knots, check_count, check_knots, leg_named, times_of_pieces,
};
use crate::drive::{self, range};
use crate::guard::{predict_shift, predict_support};
use crate::line::{body_line, wheel_line};
use crate::path::TimedPath;
use crate::phase::{Phase, Switch};
use crate::refusal::Refusal;
use crate::stand::standing;
use crate::steer::{base_heading, steer};

/// Farthest that one command moves a wheel or the body, for a robot of scale 1 (m).
const WAY_MAX: f64 = 1000.0;
/// Slowest motion of a wheel or the body that a command may ask for, for a robot of scale 1 (m/s).
const SPEED_MIN: f64 = 1e-3;
/// ... and fastest.
const SPEED_MAX: f64 = 1.0;
/// Fastest spin of a wheel in the air (rad/s), the usual one, and its acceleration (rad/s²).
const SPIN_MAX: f64 = 1.0;
const SPIN: f64 = 0.5;
const SPIN_ACCELERATION: f64 = 0.5;
/// Most turns of a wheel in the air (rad): ten times round.
const SPIN_WAY_MAX: f64 = 62.84;

impl Step {
    /// Refuses steps that no sequence has; tells which.
    pub(crate) fn check(steps: &[Step]) -> Result<(), (Option<usize>, Refusal)> {
        let n_steps = steps.len();
        if !(1..=STEPS_MAX).contains(&n_steps) {
            return Err((None, Refusal::StepCount { n_steps }));
        }
        for (i, step) in steps.iter().enumerate() {
            let what = match step.motion {
                Motion::Stop => "stop",
                Motion::CancelRest => "cancellation of the rest",
                Motion::Sequence(_) => "sequence",
                _ => continue,
            };
            return Err((Some(i), Refusal::NoStep { what }));
        }
        Ok(())
    }
}

impl SimRover {
    /// The phases of a step, if what it waits for holds.
    pub(super) fn step_phases(&self, step: &Step) -> Result<VecDeque<Phase>, Refusal> {
        if let Some(gate) = &step.gate {
            gate.0(&self.frame()).map_err(|why| Refusal::Condition { why })?;
        }
        self.phases(&step.motion)
    }

    /// The phases of a motion from where the rover is, checked.
    pub(crate) fn phases(&self, motion: &Motion) -> Result<VecDeque<Phase>, Refusal> {
        self.operation_allows(motion)?;
        let phase = match motion {
            Motion::JointPath { leg, knots } => {
                let leg = leg_named(self.scene.robot(), leg)?;
                check_count(knots.len(), KNOTS_MAX)?;
                let times = times_of_pieces(knots.iter().map(|knot| knot.time_s))?;
                let knots: Vec<_> = knots.iter().map(|knot| vec![knot.angles]).collect();
                self.leg_phase(leg, knots, &times)?
            }
            Motion::JointMove { joints, speed } => self.joint_phase(joints, *speed)?,
            Motion::WheelLine { leg, center } => {
                let leg = leg_named(self.scene.robot(), leg)?;
                let mut goal = self.posture.wheel(self.scene.robot(), leg).world_from_wheel;
                goal.translation = center.coords.into();
                self.line_phase(leg, &goal, None)?
            }
            Motion::WheelMove { leg, frame, position, rotation, speed } => {
                let leg = leg_named(self.scene.robot(), leg)?;
                let goal = self.wheel_goal(leg, *frame, position, rotation)?;
                self.line_phase(leg, &goal, *speed)?
            }
            Motion::BodyPath { knots, hold } => self.shift_phase(knots, *hold)?,
            Motion::BodyMove { translation, rotation, speed } => {
                self.body_phase(translation, rotation, *speed)?
            }
            Motion::WheelBrake { legs, on } => {
                Phase::Switch(Switch::Brakes { legs: self.wheels_named(legs)?, on: *on })
            }
            Motion::WheelRoll { leg, angle, speed } => self.roll_phase(leg, *angle, *speed)?,
            Motion::WheelSteer { headings } => self.steer_phase(headings)?,
            Motion::DriveArc(arc) => return self.drive_phases(arc),
            Motion::Hold => {
                let legs = self.scene.robot().leg_ids().collect();
                Phase::Switch(Switch::Brakes { legs, on: true })
            }
            Motion::Mode(operating) => Phase::Switch(Switch::Mode(*operating)),
            Motion::Stop => return Err(Refusal::NoStep { what: "stop" }),
            Motion::CancelRest => {
                return Err(Refusal::NoStep { what: "cancellation of the rest" });
            }
            Motion::Sequence(_) => return Err(Refusal::NoStep { what: "sequence" }),
        };
        Ok(VecDeque::from([phase]))
    }

    /// Refuses what the mode of operation or the brakes do not allow.
    fn operation_allows(&self, motion: &Motion) -> Result<(), Refusal> {
        let (what, needed) = match motion {
            Motion::Hold | Motion::Mode(_) | Motion::Stop | Motion::CancelRest => return Ok(()),
            Motion::Sequence(_) | Motion::WheelBrake { on: true, .. } => return Ok(()),
            Motion::WheelBrake { .. } => ("releasing a brake", Operating::Driving),
            Motion::WheelRoll { .. } => ("rolling a wheel", Operating::Driving),
            Motion::WheelSteer { .. } => ("steering", Operating::Driving),
            Motion::DriveArc(_) => ("driving", Operating::Driving),
            Motion::JointPath { .. } | Motion::JointMove { .. } => ("a leg", Operating::Ready),
            Motion::WheelLine { .. } | Motion::WheelMove { .. } => ("a leg", Operating::Ready),
            Motion::BodyPath { .. } | Motion::BodyMove { .. } => ("the body", Operating::Ready),
        };
        let present = self.operating;
        let is_low = present == Operating::Safe
            || (needed == Operating::Driving && present != Operating::Driving);
        if is_low {
            let (needed, present) = (needed.name(), present.name());
            return Err(Refusal::WrongMode { what, needed, present });
        }
        let drives_hold = matches!(motion, Motion::BodyPath { hold: WheelHold::Drives, .. });
        if needed == Operating::Ready
            && !drives_hold
            && let Some(leg) = standing(&self.feet)
                .into_iter()
                .map(|(leg, _)| leg)
                .find(|leg| !self.wheels[leg.0].brake)
        {
            return Err(Refusal::BrakeOff { leg: self.scene.robot().leg(leg).name.clone() });
        }
        Ok(())
    }

    fn leg_phase(
        &self,
        leg: LegId,
        knots: Vec<Vec<LegAngles>>,
        times: &[f64],
    ) -> Result<Phase, Refusal> {
        let present = self.configuration.legs[leg.0];
        check_knots(self.scene.robot(), &[leg], &knots, &[present])?;
        let path = self.timed(vec![leg], knots, times);
        predict_support(&self.scene, &self.posture, &self.feet, leg, &path)?;
        Ok(Phase::Leg(leg, path))
    }

    fn joint_phase(&self, joints: &[(String, f64)], speed: Option<f64>) -> Result<Phase, Refusal> {
        let robot = self.scene.robot();
        let fastest = robot.motion().joint_speed;
        if let Some(speed) = speed {
            range("the speed", speed, [1e-3 * fastest, fastest], "rad/s")?;
        }
        let mut moved: Option<(LegId, LegAngles)> = None;
        for (joint, goal) in joints {
            let (leg, place) = self.joint_named(joint)?;
            let (first, angles) =
                moved.get_or_insert_with(|| (leg, self.configuration.legs[leg.0]));
            if *first != leg {
                let name = |leg: LegId| robot.leg(leg).name.clone();
                return Err(Refusal::MixedLegs { a: name(*first), b: name(leg) });
            }
            angles[place] = *goal;
        }
        let Some((leg, goal)) = moved else { return Err(Refusal::Nothing { what: "joint" }) };
        let present = self.configuration.legs[leg.0];
        let time_s = (goal - present).amax() / speed.unwrap_or(fastest);
        self.leg_phase(leg, vec![vec![present], vec![goal]], &[0.0, time_s])
    }

    fn joint_named(&self, name: &str) -> Result<(LegId, usize), Refusal> {
        let robot = self.scene.robot();
        let place_in = |leg: LegId| {
            let joints = &robot.leg(leg).joints;
            let place = joints.iter().position(|joint| robot.joints()[*joint].name == name)?;
            Some((leg, place))
        };
        robot.leg_ids().find_map(place_in).ok_or_else(|| {
            let first = robot.legs().first().and_then(|leg| leg.joints.first());
            Refusal::UnknownJoint {
                joint: name.chars().take(80).collect(),
                example: first.map(|j| robot.joints()[*j].name.clone()).unwrap_or_default(),
            }
        })
    }

    fn wheel_goal(
        &self,
        leg: LegId,
        frame: GoalFrame,
        position: &Vector3<f64>,
        rotation: &Vector3<f64>,
    ) -> Result<Isometry3<f64>, Refusal> {
        let robot = self.scene.robot();
        check_way(robot.scale(), position, rotation)?;
        let wheel = self.posture.wheel(robot, leg).world_from_wheel;
        let base = self.configuration.world_from_base;
        let turn = UnitQuaternion::from_scaled_axis(*rotation);
        let (center, turn) = match frame {
            GoalFrame::World => (*position, turn),
            GoalFrame::Offset => (wheel.translation.vector + position, turn),
            GoalFrame::Base => {
                let turn = base.rotation * turn * base.rotation.inverse();
                ((base * nalgebra::Point3::from(*position)).coords, turn)
            }
        };
        Ok(Isometry3::from_parts(center.into(), turn * wheel.rotation))
    }

    fn line_phase(
        &self,
        leg: LegId,
        goal: &Isometry3<f64>,
        speed: Option<f64>,
    ) -> Result<Phase, Refusal> {
        let robot = self.scene.robot();
        let present = &self.configuration.legs[leg.0];
        let knots = wheel_line(robot, &self.posture, leg, present, goal)?;
        let from = self.posture.wheel(robot, leg).world_from_wheel.translation.vector;
        let way = (goal.translation.vector - from).norm();
        let times = even_times(robot.scale(), knots.len(), way, speed)?;
        self.leg_phase(leg, knots.into_iter().map(|angles| vec![angles]).collect(), &times)
    }

    fn shift_phase(&self, knots: &[BodyKnot], hold: WheelHold) -> Result<Phase, Refusal> {
        let robot = self.scene.robot();
        check_count(knots.len(), BODY_KNOTS_MAX)?;
        let times = times_of_pieces(knots.iter().map(|knot| knot.time_s))?;
        let standing: Vec<LegId> = standing(&self.feet).into_iter().map(|(leg, _)| leg).collect();
        let (legs, stances) = body_knots(robot, knots, &standing)?;
        self.closed_phase(legs, stances, &times, &standing, hold)
    }

    fn body_phase(
        &self,
        translation: &Vector3<f64>,
        rotation: &Vector3<f64>,
        speed: Option<f64>,
    ) -> Result<Phase, Refusal> {
        let robot = self.scene.robot();
        check_way(robot.scale(), translation, rotation)?;
        let by = Isometry3::from_parts(
            Translation3::from(*translation),
            UnitQuaternion::from_scaled_axis(*rotation),
        );
        let standing: Vec<LegId> = standing(&self.feet).into_iter().map(|(leg, _)| leg).collect();
        let knots = body_line(robot, &self.configuration, &standing, &by)?;
        let times = even_times(robot.scale(), knots.len(), translation.norm(), speed)?;
        let legs = robot.leg_ids().collect();
        self.closed_phase(legs, knots, &times, &standing, WheelHold::Brakes)
    }

    fn closed_phase(
        &self,
        legs: Vec<LegId>,
        stances: Vec<Vec<LegAngles>>,
        times: &[f64],
        standing: &[LegId],
        hold: WheelHold,
    ) -> Result<Phase, Refusal> {
        let robot = self.scene.robot();
        let all = &self.configuration.legs;
        let present: Vec<_> = legs.iter().map(|leg| all[leg.0]).collect();
        check_knots(robot, &legs, &stances, &present)?;
        let path = self.timed(legs, stances, times);
        let closure = Closure::new(robot, &self.posture, standing, hold);
        predict_shift(&self.scene, &closure, &self.feet, all, &path)?;
        Ok(Phase::Body(closure, path))
    }

    /// The legs of these names; all where there are none.
    fn wheels_named(&self, names: &[String]) -> Result<Vec<LegId>, Refusal> {
        let robot = self.scene.robot();
        if names.is_empty() {
            return Ok(robot.leg_ids().collect());
        }
        names.iter().map(|name| leg_named(robot, name)).collect()
    }

    fn roll_phase(&self, leg: &str, angle: f64, speed: Option<f64>) -> Result<Phase, Refusal> {
        let robot = self.scene.robot();
        let leg = leg_named(robot, leg)?;
        let name = || robot.leg(leg).name.clone();
        range("the angle", angle, [-SPIN_WAY_MAX, SPIN_WAY_MAX], "rad")?;
        let speed = speed.unwrap_or(SPIN);
        range("the speed", speed, [1e-3, SPIN_MAX], "rad/s")?;
        if robot.leg(leg).wheel.ball {
            return Err(Refusal::NoWheel { leg: name() });
        }
        if self.feet[leg.0].stands {
            return Err(Refusal::WheelStands { leg: name() });
        }
        if self.wheels[leg.0].brake {
            return Err(Refusal::BrakeOn { leg: name() });
        }
        let ramped = Ramped::new(angle.abs(), speed, SPIN_ACCELERATION);
        Ok(Phase::Roll { leg, from: self.wheels[leg.0].spin, by: angle, ramped })
    }

    fn steer_phase(&self, headings: &[(String, f64)]) -> Result<Phase, Refusal> {
        let robot = self.scene.robot();
        if headings.is_empty() {
            return Err(Refusal::Nothing { what: "wheel" });
        }
        let base = base_heading(&self.configuration.world_from_base);
        let mut wanted = Vec::with_capacity(headings.len());
        for (name, heading) in headings {
            let leg = leg_named(robot, name)?;
            let full = std::f64::consts::TAU;
            range("the heading", *heading, [-full, full], "rad")?;
            if self.wheels[leg.0].brake {
                return Err(Refusal::BrakeOn { leg: robot.leg(leg).name.clone() });
            }
            wanted.push((leg, base + heading));
        }
        self.steered(&wanted)
    }

    fn steered(&self, wanted: &[(LegId, f64)]) -> Result<Phase, Refusal> {
        let knots = steer(&self.scene, &self.posture, &self.configuration.legs, wanted)?;
        let times = vec![0.0; knots.len()];
        Ok(Phase::Steer(self.timed(self.scene.robot().leg_ids().collect(), knots, &times)))
    }

    fn drive_phases(&self, arc: &DriveArc) -> Result<VecDeque<Phase>, Refusal> {
        let robot = self.scene.robot();
        let (longest, wheels) = drive::headings(robot, &self.configuration, &self.posture, arc)?;
        drive::all_stand(robot, &self.feet)?;
        if let Some(leg) = robot.leg_ids().find(|leg| self.wheels[leg.0].brake) {
            return Err(Refusal::BrakeOn { leg: robot.leg(leg).name.clone() });
        }
        let steer = self.steered(&wheels)?;
        let Phase::Steer(path) = &steer else { return Ok(VecDeque::new()) };
        let mut configuration = self.configuration.clone();
        configuration.legs = path.applied(&configuration.legs, path.goal());
        let spins: Vec<f64> = self.wheels.iter().map(|wheel| wheel.spin).collect();
        let track = drive::track(&self.scene, &configuration, arc, longest, &spins)?;
        Ok(VecDeque::from([steer, Phase::Drive(track)]))
    }

    /// The path of these legs from where they are through the knots.
    fn timed(&self, legs: Vec<LegId>, knots: Vec<Vec<LegAngles>>, times: &[f64]) -> TimedPath {
        let present = legs.iter().map(|leg| self.configuration.legs[leg.0]).collect();
        let knots = std::iter::once(present).chain(knots).collect();
        TimedPath::new(legs, knots, times, self.scene.robot().motion().joint_speed)
    }
}

/// Refuses ways and turns that are no numbers, or beyond all bounds.
fn check_way(scale: f64, way: &Vector3<f64>, turn: &Vector3<f64>) -> Result<(), Refusal> {
    let most = WAY_MAX * scale.max(1.0);
    for value in way.iter() {
        range("a position", *value, [-most, most], "m")?;
    }
    for value in turn.iter() {
        range("a rotation", *value, [-std::f64::consts::PI, std::f64::consts::PI], "rad")?;
    }
    Ok(())
}

/// The least time of each piece before a knot (s), at a speed along an even way.
fn even_times(
    scale: f64,
    n_knots: usize,
    way: f64,
    speed: Option<f64>,
) -> Result<Vec<f64>, Refusal> {
    let Some(speed) = speed else { return Ok(vec![0.0; n_knots]) };
    range("the speed", speed, [SPEED_MIN * scale, SPEED_MAX * scale], "m/s")?;
    let pieces = n_knots.saturating_sub(1).max(1) as f64;
    let mut times = vec![way / speed / pieces; n_knots];
    if let Some(first) = times.first_mut() {
        *first = 0.0;
    }
    Ok(times)
}
