//! The leg at a moment, and where its parts are then.

use nalgebra::Point3;
use rover::{Frame, LegAngles, LegFrames};

use super::{Allowance, LegChecker};
use crate::form::{Core, Placed};

/// The leg at one configuration, and how far it may get from there.
pub(crate) struct Moment<'m> {
    pub frames: &'m LegFrames,
    /// Most that each joint moves either way (rad); zero for one configuration.
    pub change: &'m LegAngles,
    pub allowance: Allowance<'m>,
    /// Ask for exact distances where quick bounds do not tell.
    pub fine: bool,
    /// Only touching counts: no clearance is kept.
    pub touch_only: bool,
    /// Counts as a way that every body may go (m).
    pub extra: f64,
}

impl Moment<'_> {
    /// One configuration.
    pub fn still<'m>(frames: &'m LegFrames, allowance: Allowance<'m>) -> Moment<'m> {
        Moment { frames, change: &STILL, allowance, fine: true, touch_only: false, extra: 0.0 }
    }

    pub(super) fn required(&self, required: f64) -> f64 {
        if self.touch_only { 0.0 } else { required }
    }
}

/// No joint moves.
static STILL: LegAngles = LegAngles::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0);

/// A moving part at a moment: where, and how far any of its points can get from there (m).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Here {
    pub placed: Placed,
    pub motion: f64,
}

/// The center of the moving wheel at a moment.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Foot {
    pub center: Point3<f64>,
    pub motion: f64,
}

/// What has been placed at the present moment: each part when it is first asked for.
pub(crate) struct Scratch {
    pub parts: Vec<Here>,
    /// Which of them hold.
    placed: Vec<bool>,
    pub(super) foot: Foot,
    foot_placed: bool,
}

impl Scratch {
    pub fn new(checker: &LegChecker) -> Scratch {
        let nowhere = Placed::new(Frame::identity(), &Core::default());
        let n = checker.moving.len();
        Scratch {
            parts: vec![Here { placed: nowhere, motion: 0.0 }; n],
            placed: vec![false; n],
            foot: Foot { center: Point3::origin(), motion: 0.0 },
            foot_placed: false,
        }
    }

    /// Another moment begins.
    pub fn clear(&mut self) {
        self.placed.fill(false);
        self.foot_placed = false;
    }

    pub fn place(&mut self, checker: &LegChecker, moment: &Moment, index: usize) {
        if self.placed[index] {
            return;
        }
        self.placed[index] = true;
        let moving = &checker.moving[index];
        let frame = moment.frames.links[moving.place].after(&moving.place_from_part);
        let placed = Placed::new(frame, &moving.part.core);
        let [a, b] = placed.ends();
        let motion = if std::ptr::eq(moment.change, &STILL) {
            moment.extra
        } else {
            moment.frames.motion_bound(moving.place, 0, [&a, &b], placed.radius, moment.change)
        };
        self.parts[index] = Here { placed, motion };
    }

    pub fn place_foot(&mut self, checker: &LegChecker, moment: &Moment) {
        self.foot_motion(checker, moment.frames, moment.change);
    }

    /// How far the foot's center can get (m).
    pub fn foot_motion(
        &mut self,
        checker: &LegChecker,
        frames: &LegFrames,
        change: &LegAngles,
    ) -> f64 {
        if !self.foot_placed {
            self.foot_placed = true;
            let wheel = &checker.scene.robot().leg(checker.leg).wheel;
            let center = Point3::from(wheel.carrier_from_wheel.translation.vector);
            let center = frames.links[5].point(&center);
            let motion = frames.motion_bound(5, 0, [&center, &center], 0.0, change);
            self.foot = Foot { center, motion };
        }
        self.foot.motion
    }

    /// How far the part that has been looked at can get (m).
    pub fn motion(&self, index: usize) -> f64 {
        self.parts[index].motion
    }
}
