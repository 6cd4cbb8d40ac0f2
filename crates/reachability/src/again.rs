//! An answer brought up to date where the ground has changed.

use nalgebra::Point2;
use rover::{Configuration, JointKind, LegId, LinkId};

use collision::Scene;

use crate::answer::{ReachGrid, ReachOptions};
use crate::look::{Look, seen};
use crate::reach::{Job, Tile, run};
use crate::strip::Strip;

/// A rectangle seen from above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Area {
    /// Lowest x and y (m).
    pub min: Point2<f64>,
    /// Highest x and y (m).
    pub max: Point2<f64>,
}

impl Area {
    /// Distance of a point (m), zero inside.
    pub(crate) fn distance(&self, p: &Point2<f64>) -> f64 {
        let beside = |v: f64, lo: f64, hi: f64| (lo - v).max(v - hi).max(0.0);
        beside(p.x, self.min.x, self.max.x).hypot(beside(p.y, self.min.y, self.max.y))
    }
}

/// What [`reach`](crate::reach) answers, given its answer `before` to the same question on ground (or
/// among obstacles) that was the same outside of `changed`.
///
/// The classes of [`ReachOptions::ground`] count as ground: where they differ is within `changed`, too.
///
/// Only those tiles of cells are found anew that the change can matter to: a part of the leg is never
/// farther from the hip and from the place of the wheel together than the leg is long, and where thigh and
/// calf lie in a plane with the hip's yaw axis, never far beside the line from there to the wheel. Where a
/// wheel stands on changed ground, or `before` has other cells, all is found anew.
#[allow(clippy::too_many_arguments)] // those of `reach`, the answer before and what changed
pub fn reach_again(
    before: &ReachGrid,
    changed: &Area,
    scene: &Scene,
    configuration: &Configuration,
    gravity: f64,
    leg: LegId,
    options: &ReachOptions,
    stop: &(dyn Fn() -> bool + Sync),
) -> Option<ReachGrid> {
    let seen = seen(scene, configuration);
    let look = Look::new(scene, configuration, &seen, gravity, leg, options);
    let grid = look.grid()?;
    let mut job = Job::new(&look, grid)?;
    if *before.grid() == grid && !look.stands_on(changed) {
        job.take(before);
        let reach = look.reach_about_wheel();
        let hip = changed.distance(&look.hip.xy());
        let strip = Strip::new(&look);
        let matters = |p: Point2<f64>| {
            (p - look.hip.xy()).norm() <= look.reach
                && hip + changed.distance(&p) <= reach
                && strip.as_ref().is_none_or(|strip| strip.may_meet(changed, p))
        };
        job.tiles.retain(|tile| cells(tile).any(|(ix, iy)| matters(grid.position(ix, iy))));
    }
    let mut jobs = vec![job];
    run(&mut jobs, options.workers, stop)?;
    ReachGrid::of(grid, &jobs.pop()?.cells)
}

fn cells(tile: &Tile) -> impl Iterator<Item = (usize, usize)> + '_ {
    tile.rows.clone().flat_map(|iy| tile.columns.clone().map(move |ix| (ix, iy)))
}

impl Look<'_> {
    /// True if a wheel of the robot may be over the area, or a patch of ground whose normal counts.
    fn stands_on(&self, area: &Area) -> bool {
        let mut wheels = self.robot.leg_ids().map(|leg| self.posture.wheel(self.robot, leg));
        let mut contacts = self.standing.iter().map(|(_, contact)| contact.position);
        wheels.any(|wheel| area.distance(&wheel.center().xy()) <= self.about_seat())
            || contacts.any(|contact| area.distance(&contact.xy()) <= self.about_seat())
    }

    /// How far from a wheel's center the ground matters to how it sits (m): what is below the wheel, and the patch of
    /// which the normal counts, which is no farther than the wheel is wide.
    pub fn about_seat(&self) -> f64 {
        let wheel = &self.robot.leg(self.leg).wheel;
        // A square of the map is known by its corners, and a changed node changes all about it.
        let cell = self.scene.map().grid().resolution;
        wheel.radius.hypot(0.5 * wheel.width).max(wheel.width) + 3.0 * cell
    }

    /// How far from a wheel's center the ground matters to how it sits and what it touches (m).
    fn about_wheel(&self) -> f64 {
        let wheel = &self.robot.leg(self.leg).wheel;
        let patch = 2.0 * wheel.width.max(wheel.radius);
        // A square of the map is known by its corners, and a changed node changes all about it.
        let cell = self.scene.map().grid().resolution;
        wheel.radius + wheel.width + patch + 3.0 * cell
    }

    /// Most that the distances of a point of the leg from the hip and from the place of its wheel can
    /// be together where that point may meet changed ground (m).
    fn reach_about_wheel(&self) -> f64 {
        let leg = self.robot.leg(self.leg);
        let origin = |link| self.posture.link(link).translation.vector;
        let wheel = self.posture.wheel(self.robot, self.leg).center().coords;
        let along: Vec<_> = leg.links.iter().map(|link| origin(*link)).chain([wheel]).collect();
        // Joints that turn leave these lengths as they are; those that slide add their strokes.
        let length: f64 = along.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        let kind = |place: usize| self.robot.joints()[leg.joints[place]].kind;
        let slides = (0..leg.n_joints()).filter(|place| kind(*place) == JointKind::Prismatic);
        let strokes: f64 = slides.map(|place| leg.upper[place] - leg.lower[place]).sum();
        // How far the leg's parts lie from the origin of the link that moves them.
        let mut stoutest = 0.0_f64;
        for (i, link) in self.robot.links().iter().enumerate() {
            let Some((of, place)) = self.robot.body_of(LinkId(i)) else { continue };
            if of != self.leg {
                continue;
            }
            let away = (origin(LinkId(i)) - origin(leg.links[place])).norm();
            for shape in &link.shapes {
                let center = shape.link_from_shape.translation.vector.norm();
                stoutest = stoutest.max(away + center + shape.shape.bounding_radius());
            }
        }
        let tolerance = self.robot.tolerances().environment;
        length + strokes + 2.0 * (stoutest + tolerance + self.about_wheel())
    }
}
