//! Cells against brute force: every way that `touchdowns` has, by the full assessment of the stance, the
//! plain checker, and inverse kinematics on the posture.

use std::collections::BTreeSet;

use collision::{
    Allowance, ContactZone, LegChecker, NoTouchdown, Scene, Touch, Touchdown, survey, touchdowns,
};
use nalgebra::{Point2, Point3, Translation3};
use reachability::{CellClass, Obstruction, ReachOptions, Reason, WheelHeading, explain, reach};
use rover::{Configuration, LegAngles, LegId, LinkId, Posture};
use stability::rule::{self, Check, Preference};

use crate::scenes::{athlete, boulders, seated};

struct Brute<'a> {
    scene: &'a Scene,
    posture: Posture,
    leg: LegId,
    near: LegAngles,
    standing: Vec<(LegId, Point3<f64>)>,
    checker: LegChecker<'a>,
    gravity: f64,
    preference: Preference,
    lift: f64,
}

impl<'a> Brute<'a> {
    fn new(
        scene: &'a Scene,
        start: &Configuration,
        leg: LegId,
        gravity: f64,
        options: &ReachOptions,
    ) -> Brute<'a> {
        let posture = Posture::new(scene.robot(), start);
        let mut standing = survey(scene, &posture).contacts(scene, &posture);
        standing.retain(|(other, _)| *other != leg);
        Brute {
            scene,
            leg,
            near: start.legs[leg.0],
            standing,
            checker: LegChecker::new(scene, &posture, leg, None, None),
            posture,
            gravity,
            preference: options.preference,
            lift: options.lift,
        }
    }

    fn zone(&self, way: &Touchdown) -> ContactZone {
        let rules = self.scene.robot().stance();
        ContactZone {
            contact: way.contact,
            center: way.wheel.center(),
            radius: rules.contact_radius,
            height: rules.contact_height,
            ground_tolerance: rules.ground_tolerance,
        }
    }

    /// How far a way gets, and what it then lacks.
    fn way(&self, way: &Touchdown) -> (u8, Reason) {
        let robot = self.scene.robot();
        let posture = self.posture.with_leg(robot, self.leg, &way.angles);
        let report = rule::assess(robot, &posture, &self.standing, self.gravity);
        let verdict = rule::verdict(&report, robot.stance(), self.preference);
        if !verdict.ok {
            let settles = verdict.check == Check::Settlement;
            return (0, if settles { Reason::Settlement } else { Reason::Margin });
        }
        if report.torque.worst.ratio.abs() > 1.0 {
            return (0, Reason::Torque);
        }
        let zone = self.zone(way);
        if let Some(violation) = self.checker.violation(&posture, Some(&zone)) {
            let own = matches!(violation.touch, Touch::Links(..));
            return (1, if own { Reason::SelfCollision } else { Reason::EnvironmentCollision });
        }
        let Some(raised) = self.raised(way) else { return (2, Reason::LiftOutOfReach) };
        match self.checker.violation_at(&raised, Allowance::default()) {
            Some(_) => (3, Reason::LiftCollides),
            None => (4, Reason::None),
        }
    }

    fn raised(&self, way: &Touchdown) -> Option<LegAngles> {
        let above = Translation3::new(0.0, 0.0, self.lift) * way.wheel.world_from_wheel;
        let all = self.posture.inverse_kinematics(self.scene.robot(), self.leg, &above).ok()?;
        let within = all.iter().filter(|s| s.within_limits).map(|s| s.angles);
        let from = |q: &LegAngles| (q - way.angles).amax();
        within.min_by(|a, b| from(a).total_cmp(&from(b)))
    }

    /// The class and the reasons that may stand for it.
    fn cell(&self, p: Point2<f64>) -> (CellClass, Vec<Reason>) {
        let robot = self.scene.robot();
        let model = robot.leg(self.leg);
        let hip = self.posture.link(model.links[0]).translation.vector;
        if (p - Point2::new(hip.x, hip.y)).norm() > model.ik.reach() {
            return (CellClass::Unreachable, vec![Reason::OutOfReach]);
        }
        let ways = touchdowns(self.scene, &self.posture, self.leg, p, &self.near, 1000);
        let ways = match ways {
            Ok(ways) => ways,
            Err(NoTouchdown::UnknownGround) => {
                return (CellClass::Unknown, vec![Reason::UnknownGround]);
            }
            Err(NoTouchdown::Uneven { .. }) => {
                return (CellClass::Unreachable, vec![Reason::Uneven]);
            }
            Err(NoTouchdown::OutOfReach { .. }) => {
                return (CellClass::Unreachable, vec![Reason::OutOfReach]);
            }
            Err(NoTouchdown::JointLimits { .. }) => {
                return (CellClass::Unreachable, vec![Reason::JointLimit]);
            }
        };
        let all: Vec<(u8, Reason)> = ways.iter().map(|way| self.way(way)).collect();
        let furthest = all.iter().map(|(rank, _)| *rank).max().unwrap();
        let class = match furthest {
            0 => CellClass::Unstable,
            1 => CellClass::Colliding,
            4 => CellClass::Reachable,
            _ => CellClass::NoLift,
        };
        (class, all.into_iter().filter(|(rank, _)| *rank == furthest).map(|(_, r)| r).collect())
    }
}

#[test]
fn cells_are_what_brute_force_finds_and_each_reachable_one_has_a_way_that_holds() {
    let mut seen = BTreeSet::new();
    let (mut n_cells, mut n_more) = (0, 0);
    let both = [Preference::Regular, Preference::Conservative];
    for (seed, gravity, leg) in [(3, 1.62, 0), (4, 9.81, 1), (5, 3.71, 4)] {
        let scene = Scene::new(athlete(), boulders(seed), &[]).unwrap();
        let start = seated(&scene);
        let leg = LegId(leg);
        let preference = both[seed as usize % 2];
        let options =
            ReachOptions { resolution: 0.24, preference, workers: 2, ..Default::default() };
        let grid = reach(&scene, &start, gravity, leg, &options, &|| false).unwrap();
        let brute = Brute::new(&scene, &start, leg, gravity, &options);
        for iy in 0..grid.grid().ny {
            for ix in 0..grid.grid().nx {
                let p = grid.grid().position(ix, iy);
                let class = CellClass::from_number(*grid.class.at(ix, iy));
                let reason = Reason::from_number(*grid.reason.at(ix, iy));
                let (expected, reasons) = brute.cell(p);
                n_cells += 1;
                seen.insert(reason as u8);
                // Mends take time: not for every cell.
                if class == CellClass::Reachable || (ix + iy) % 9 == 0 {
                    let explained = explain(&scene, &start, gravity, leg, p, &options).unwrap();
                    assert_eq!((explained.class, explained.reason), (class, reason), "{p}");
                    let way = explained.way.filter(|_| class == CellClass::Reachable);
                    assert!(way.is_none_or(|way| brute.way(&way) == (4, Reason::None)), "{p}");
                }
                if class == expected {
                    assert!(reasons.contains(&reason), "{p}: {reason:?}, not {reasons:?}");
                } else {
                    // Brute force drops orientations that are beyond the limits before they are
                    // seated: a way may come from one of these.
                    n_more += 1;
                    assert!(expected != CellClass::Reachable, "{p}: {class:?}, {reason:?}");
                }
            }
        }
    }
    assert!(n_cells > 1500 && 100 * n_more < n_cells, "{n_more} of {n_cells}");
    for reason in [Reason::Margin, Reason::SelfCollision, Reason::LiftCollides] {
        assert!(seen.contains(&(reason as u8)), "{reason:?} never came up");
    }
}

#[test]
fn what_is_missing_at_the_waypoint_is_what_exact_shapes_say() {
    let mut off = Vec::new();
    for seed in [3, 7, 8] {
        let scene = Scene::new(athlete(), boulders(seed), &[]).unwrap();
        let start = seated(&scene);
        let options = ReachOptions { resolution: 0.1, workers: 2, ..Default::default() };
        let leg = LegId(1);
        let posture = Posture::new(scene.robot(), &start);
        let grid = reach(&scene, &start, 1.62, leg, &options, &|| false).unwrap();
        for iy in 0..grid.grid().ny {
            for ix in 0..grid.grid().nx {
                if *grid.reason.at(ix, iy) != Reason::LiftCollides as u8 {
                    continue;
                }
                let p = grid.grid().position(ix, iy);
                let explained = explain(&scene, &start, 1.62, leg, p, &options).unwrap();
                let Some(Obstruction::Bodies { link, other, .. }) = explained.obstruction else {
                    panic!("{p}: {:?}", explained.obstruction);
                };
                // By parry's shapes, over all parts of both.
                let raised = posture.with_leg(scene.robot(), leg, &explained.raised.unwrap());
                let seen = survey(&scene, &raised);
                let name = |link: LinkId| scene.robot().links()[link.0].name.as_str();
                let is_it = |touch: Touch| match touch {
                    Touch::Ground(of) => name(of) == link && other == "ground",
                    Touch::Links(a, b) => {
                        [name(a), name(b)] == [&link, &other]
                            || [name(b), name(a)] == [&link, &other]
                    }
                    _ => false,
                };
                let mut all = seen.environment.iter().chain(&seen.links);
                let near = all.find(|near| is_it(near.touch)).unwrap();
                let found = f64::from(*grid.missing.at(ix, iy));
                off.push(near.tolerance - near.distance - found);
            }
        }
    }
    let worst = off.iter().map(|off| off.abs()).fold(0.0, f64::max);
    assert!(off.len() > 20, "{}", off.len());
    assert!(worst < 1.5e-4, "{worst} {off:?}");
}

#[test]
fn a_fixed_wheel_stands_along_its_heading_and_reaches_no_more_than_a_free_one() {
    let scene = Scene::new(athlete(), boulders(6), &[]).unwrap();
    let start = seated(&scene);
    let leg = LegId(2);
    let free = ReachOptions { resolution: 0.3, workers: 2, ..Default::default() };
    let heading = 0.7_f64;
    let fixed = ReachOptions { heading: WheelHeading::Fixed(heading), ..free };
    let any = reach(&scene, &start, 1.62, leg, &free, &|| false).unwrap();
    let along = reach(&scene, &start, 1.62, leg, &fixed, &|| false).unwrap();
    let count = |values: &[u8]| values.iter().filter(|c| **c == CellClass::Reachable as u8).count();
    assert!(count(along.class.values()) > 10);
    assert!(count(along.class.values()) < count(any.class.values()));
    for iy in 0..along.grid().ny {
        for ix in 0..along.grid().nx {
            if *along.class.at(ix, iy) != CellClass::Reachable as u8 {
                continue;
            }
            let p = along.grid().position(ix, iy);
            let way = explain(&scene, &start, 1.62, leg, p, &fixed).unwrap().way.unwrap();
            let axle = way.wheel.axle();
            let across = axle.x * heading.cos() + axle.y * heading.sin();
            // The axle is level with the ground, so across the heading but for the ground's slope.
            assert!(across.abs() < 0.35 && way.wheel.camber(&way.place.normal) < 1e-6, "{across}");
        }
    }
}
