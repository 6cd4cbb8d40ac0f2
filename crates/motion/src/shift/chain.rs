//! The closed chain of a rover on planted wheels: joint angles for a pose of the chassis.
//!
//! With closed-form leg kinematics a pose of the chassis gives the angles of every planted leg, so
//! the stance manifold (H22-H29) is parametrized by six numbers and needs no iteration. Hip and knee of
//! a leg keep the branch of the start. The wrist takes the branch that is nearer: a way through the
//! straight wrist changes it, and may be gone where the wheel does not leave its place, which is
//! looked at for every piece. Frame `world`, meters, radians.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rover::{Branch, Configuration, IkSolution, LegAngles, LegId, Posture, Robot};

use super::executed::{Executed, between};

/// Largest change of a joint between two samples of a way (rad): a larger one is a jump past a
/// singularity.
const JUMP: f64 = 0.35;

/// Angles nearer than this are the same (rad).
const SAME: f64 = 1e-6;

/// Length of the chassis' way between two samples (m at scale 1, and rad).
const SAMPLING: f64 = 0.02;

/// Points of a way at which the search looks whether the legs can follow.
const COARSE_SAMPLES: usize = 16;

/// Fork pitches that a held wheel may take from its start, by size (rad): least and count.
const FORK_STEP: f64 = 0.05;
const FORK_STEPS: i32 = 12;

/// Share of the closure tolerance that the sampled deviation of a piece may take; the rest is for
/// what lies between samples.
const CLOSURE_SHARE: f64 = 0.9;

/// What keeps a leg from following the chassis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Obstruction {
    /// Its wrist would be out of reach.
    Reach {
        /// The leg.
        leg: LegId,
        /// How far (m).
        distance: f64,
    },
    /// A joint would leave its limits.
    Limit {
        /// The leg.
        leg: LegId,
        /// The joint, 0 to 5 from the hip outward.
        joint: usize,
        /// How far (rad).
        beyond: f64,
    },
    /// It would have to pass a straight knee, a straight wrist or the hip-yaw axis.
    Singular {
        /// The leg.
        leg: LegId,
    },
}

impl Obstruction {
    /// In words for people: legs counted from 1, degrees.
    pub fn text(&self, robot: &Robot) -> String {
        let name = |leg: LegId| robot.legs().get(leg.0).map_or("?", |leg| leg.name.as_str());
        match *self {
            Obstruction::Reach { leg, distance } => {
                format!("the planted wheel of {} is {distance:.2} m out of reach", name(leg))
            }
            Obstruction::Limit { leg, joint, beyond } => {
                let index = robot.leg(leg).joints[joint];
                let degrees = beyond.to_degrees();
                format!("{} would be {degrees:.1} deg beyond its limit", robot.joints()[index].name)
            }
            Obstruction::Singular { leg } => {
                format!("{} would have to pass a singular posture", name(leg))
            }
        }
    }
}

struct Planted {
    leg: LegId,
    world_from_wheel: Isometry3<f64>,
    branch: Option<Branch>,
}

/// The rover on its planted wheels.
pub(crate) struct ClosedChain<'a> {
    pub robot: &'a Robot,
    pub start: &'a Configuration,
    planted: Vec<Planted>,
    drive_hold: bool,
}

/// A pose of the chassis with the fork pitch of each planted leg, from the start's (rad).
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ChainPose {
    pub world_from_base: Isometry3<f64>,
    forks: Vec<f64>,
    /// Joint angles there.
    legs: Vec<LegAngles>,
}

impl<'a> ClosedChain<'a> {
    pub fn new(
        robot: &'a Robot,
        start: &'a Configuration,
        legs: &[LegId],
        drive_hold: bool,
    ) -> ClosedChain<'a> {
        let posture = Posture::new(robot, start);
        let planted = legs
            .iter()
            .map(|&leg| {
                let world_from_wheel = posture.wheel(robot, leg).world_from_wheel;
                let near = |q: &LegAngles| (q - start.legs[leg.0]).amax();
                let branch = posture
                    .inverse_kinematics(robot, leg, &world_from_wheel)
                    .ok()
                    .and_then(|all| {
                        all.into_iter().min_by(|a, b| near(&a.angles).total_cmp(&near(&b.angles)))
                    })
                    .map(|solution| solution.branch);
                Planted { leg, world_from_wheel, branch }
            })
            .collect();
        ClosedChain { robot, start, planted, drive_hold }
    }

    pub fn legs(&self) -> Vec<LegId> {
        self.planted.iter().map(|planted| planted.leg).collect()
    }

    fn leg_angles(
        &self,
        planted: &Planted,
        base: &Isometry3<f64>,
        fork: f64,
        near: &LegAngles,
    ) -> Result<LegAngles, Obstruction> {
        let leg = planted.leg;
        let model = self.robot.leg(leg);
        let turned = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), fork);
        let wheel = base.inverse() * planted.world_from_wheel * turned;
        let all = model
            .ik
            .solve(model, &wheel)
            .map_err(|missed| Obstruction::Reach { leg, distance: missed.distance })?;
        let branch = planted.branch.ok_or(Obstruction::Singular { leg })?;
        let wrist_apart =
            |b: &Branch| (b.outward, b.knee_flipped) == (branch.outward, branch.knee_flipped);
        let mut on_branch: Vec<&IkSolution> =
            all.iter().filter(|solution| wrist_apart(&solution.branch)).collect();
        let far = |solution: &IkSolution| (solution.angles - near).amax();
        on_branch.sort_by(|a, b| far(a).total_cmp(&far(b)));
        if let Some(solution) = on_branch.iter().find(|solution| solution.within_limits) {
            return Ok(solution.angles);
        }
        let beyond = on_branch
            .iter()
            .map(|solution| (solution.angles - model.upper).sup(&(model.lower - solution.angles)))
            .min_by(|a, b| a.max().total_cmp(&b.max()))
            .ok_or(Obstruction::Singular { leg })?;
        let joint = beyond.imax();
        Err(Obstruction::Limit { leg, joint, beyond: beyond[joint] })
    }

    /// Joint angles for a pose of the chassis, each fork pitched as little as it can be.
    pub fn reach(&self, base: &Isometry3<f64>) -> Result<(Configuration, ChainPose), Obstruction> {
        let mut configuration = self.start.clone();
        configuration.world_from_base = *base;
        let mut forks = Vec::with_capacity(self.planted.len());
        for planted in &self.planted {
            let near = &self.start.legs[planted.leg.0];
            let pitched =
                |fork: f64| self.leg_angles(planted, base, fork, near).map(|angles| (angles, fork));
            let mut found = pitched(0.0);
            for i in 1..=FORK_STEPS {
                if found.is_ok() || !self.drive_hold {
                    break;
                }
                for fork in [f64::from(i) * FORK_STEP, -f64::from(i) * FORK_STEP] {
                    found = found.or_else(|first| pitched(fork).map_err(|_| first));
                }
            }
            let (angles, fork) = found?;
            configuration.legs[planted.leg.0] = angles;
            forks.push(fork);
        }
        let legs = configuration.legs.clone();
        Ok((configuration, ChainPose { world_from_base: *base, forks, legs }))
    }

    /// The chassis on the straight way (even in place and turn) from the start to `goal`.
    fn along(
        &self,
        goal: &ChainPose,
        t: f64,
        before: &Configuration,
    ) -> Result<Configuration, Obstruction> {
        let base = between(&self.start.world_from_base, &goal.world_from_base, t);
        let mut configuration = self.start.clone();
        configuration.world_from_base = base;
        for (planted, fork) in self.planted.iter().zip(&goal.forks) {
            let near = &before.legs[planted.leg.0];
            configuration.legs[planted.leg.0] = self.leg_angles(planted, &base, fork * t, near)?;
        }
        Ok(configuration)
    }

    /// Can the legs follow the chassis to `goal` on their branches? Looks at a few points only.
    pub fn follows(&self, goal: &ChainPose) -> Result<(), Obstruction> {
        self.samples(goal, COARSE_SAMPLES).map(|_| ())
    }

    /// Configurations on the way from the start to `goal`, without a jump from one to the next.
    fn samples(&self, goal: &ChainPose, n: usize) -> Result<Vec<Configuration>, Obstruction> {
        let mut samples: Vec<Configuration> = vec![self.start.clone()];
        for i in 1..=n {
            let before = &samples[i - 1];
            let here = self.along(goal, i as f64 / n as f64, before)?;
            let jumped = self.planted.iter().find(|planted| {
                (here.legs[planted.leg.0] - before.legs[planted.leg.0]).amax() > JUMP
            });
            if let Some(planted) = jumped {
                return Err(Obstruction::Singular { leg: planted.leg });
            }
            samples.push(here);
        }
        // The way must come to the goal's own branches.
        let end = &samples[n];
        let other =
            |planted: &&Planted| (end.legs[planted.leg.0] - goal.legs[planted.leg.0]).amax() > SAME;
        match self.planted.iter().find(other) {
            Some(planted) => Err(Obstruction::Singular { leg: planted.leg }),
            None => Ok(samples),
        }
    }

    /// Knots of the way from the start to `goal`, such that between them the wheels keep to their
    /// places within `closure` (m); and the largest deviation seen (m).
    pub fn way(
        &self,
        goal: &ChainPose,
        closure: f64,
    ) -> Result<(Vec<Configuration>, f64), Obstruction> {
        let (from, to) = (&self.start.world_from_base, &goal.world_from_base);
        let length = (to.translation.vector - from.translation.vector).norm();
        let turn = from.rotation.angle_to(&to.rotation);
        let fork = goal.forks.iter().fold(0.0, |most: f64, fork| most.max(fork.abs()));
        let steps = (length / self.robot.scale()).max(turn).max(fork) / SAMPLING;
        let n = steps.ceil().clamp(8.0, 2_000.0) as usize;
        let samples = self.samples(goal, n)?;
        Ok(self.thinned(&samples, closure))
    }

    fn thinned(&self, samples: &[Configuration], closure: f64) -> (Vec<Configuration>, f64) {
        let mut knots = vec![samples[0].clone()];
        let mut largest: f64 = 0.0;
        let mut stack = vec![(0, samples.len() - 1)];
        let legs = self.legs();
        while let Some((a, b)) = stack.pop() {
            let deviation =
                Executed::new(self.robot, &samples[a], &samples[b], &legs).largest_deviation();
            let keeps = deviation <= CLOSURE_SHARE * closure;
            if !keeps && b - a > 1 {
                let middle = (a + b) / 2;
                stack.push((middle, b));
                stack.push((a, middle));
            } else {
                largest = largest.max(deviation);
                knots.push(samples[b].clone());
            }
        }
        (knots, largest)
    }
}
