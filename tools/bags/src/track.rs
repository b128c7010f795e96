//! Where the robot was: the poses of a bag as odometry at the rate that a graph expects.

use crate::rigid::Rigid;
use crate::tree::GAP_NS;
use sidestep_import::ODOMETRY_NS;
use sidestep_msgs::{Odometry, Pose2, Twist, wrap_angle};

/// `[ns]` odometry whose usual step is longer is filled up to 100 Hz.
const SPARSE_NS: u64 = 20_000_000;
/// `[m]`, `[m/s]` a longer step at a higher speed is a jump of the pose, not a motion.
const JUMP: (f64, f64) = (0.3, 10.0);

/// One pose of the bag.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sample {
    pub(crate) stamp_ns: u64,
    /// Graph time of its arrival.
    pub(crate) now_ns: u64,
    pub(crate) pose: Pose2,
    pub(crate) roll_rad: f64,
    pub(crate) pitch_rad: f64,
    /// `None` where only poses are known.
    pub(crate) twist: Option<Twist>,
    pub(crate) variance: [f32; 3],
    pub(crate) pose_epoch: u32,
}

impl Sample {
    /// From the pose of base in odom.
    pub(crate) fn new(stamp_ns: u64, now_ns: u64, rigid: &Rigid) -> Self {
        let (pose, roll_rad, pitch_rad) = rigid.angles();
        Self { stamp_ns, now_ns, pose, roll_rad, pitch_rad, twist: None, variance: [0.0; 3], pose_epoch: 0 }
    }

    fn odometry(&self) -> Odometry {
        Odometry {
            stamp_ns: self.stamp_ns,
            pose: self.pose,
            twist: self.twist.unwrap_or(Twist::STOP),
            roll_rad: self.roll_rad as f32,
            pitch_rad: self.pitch_rad as f32,
            variance: self.variance,
            pose_epoch: self.pose_epoch,
            ..Odometry::default()
        }
    }

    /// Between this and the next sample, which is of the same epoch.
    fn between(&self, next: &Self, stamp_ns: u64) -> Self {
        let span_ns = next.stamp_ns - self.stamp_ns;
        let part = stamp_ns.saturating_sub(self.stamp_ns) as f64 / span_ns as f64;
        let mix = |a: f64, b: f64| a + (b - a) * part;
        let pose = self.pose.interpolate(&next.pose, part);
        let twist = self.twist.zip(next.twist).map_or_else(
            || speed(&pose, self, next),
            |(a, b)| {
                let mix = |a: f32, b: f32| mix(f64::from(a), f64::from(b)) as f32;
                Twist::new(mix(a.v_m_s, b.v_m_s), mix(a.w_rad_s, b.w_rad_s))
            },
        );
        Self {
            stamp_ns,
            now_ns: stamp_ns,
            pose,
            roll_rad: mix(self.roll_rad, next.roll_rad),
            pitch_rad: mix(self.pitch_rad, next.pitch_rad),
            twist: Some(twist),
            ..*self
        }
    }
}

/// The speed that leads from one pose to the next, as seen at a pose between them.
fn speed(at: &Pose2, from: &Sample, to: &Sample) -> Twist {
    let span_s = (to.stamp_ns - from.stamp_ns) as f64 * 1e-9;
    let ahead_m = at.relative(&to.pose).x_m - at.relative(&from.pose).x_m;
    let turn_rad = wrap_angle(to.pose.yaw_rad - from.pose.yaw_rad);
    Twist::new((ahead_m / span_s) as f32, (turn_rad / span_s) as f32)
}

/// The poses of a bag, in order.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Track {
    samples: Vec<Sample>,
    sparse: bool,
}

impl Track {
    /// Orders samples, drops repeated stamps, and begins an epoch at each jump.
    pub(crate) fn new(mut samples: Vec<Sample>) -> Self {
        samples.sort_by_key(|sample| sample.stamp_ns);
        samples.dedup_by_key(|sample| sample.stamp_ns);
        let mut jumps = 0;
        for at in 1..samples.len() {
            let (before, sample) = (samples[at - 1], &mut samples[at]);
            let step_m = before.pose.distance_m(&sample.pose);
            let step_s = (sample.stamp_ns - before.stamp_ns) as f64 * 1e-9;
            jumps += u32::from(step_m > JUMP.0 && step_m > JUMP.1 * step_s);
            sample.pose_epoch += jumps;
        }
        let mut steps: Vec<u64> =
            samples.windows(2).map(|pair| pair[1].stamp_ns - pair[0].stamp_ns).collect();
        let middle = steps.len() / 2;
        let sparse = !steps.is_empty() && *steps.select_nth_unstable(middle).1 > SPARSE_NS;
        Self { samples, sparse }
    }

    pub(crate) fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// Whether the odometry is filled up to 100 Hz.
    pub(crate) fn is_sparse(&self) -> bool {
        self.sparse
    }

    /// Stamps of the first and last pose.
    pub(crate) fn span_ns(&self) -> Option<(u64, u64)> {
        Some((self.samples.first()?.stamp_ns, self.samples.last()?.stamp_ns))
    }

    /// Length of the way, jumps left out.
    pub(crate) fn distance_m(&self) -> f64 {
        let same = |pair: &&[Sample]| pair[0].pose_epoch == pair[1].pose_epoch;
        self.samples.windows(2).filter(same).map(|pair| pair[0].pose.distance_m(&pair[1].pose)).sum()
    }

    /// The odometry to write: time of arrival and message, in order.
    pub(crate) fn odometry(&self) -> Box<dyn Iterator<Item = (u64, Odometry)> + '_> {
        let plain = |sample: Sample| (sample.now_ns, sample.odometry());
        if !self.sparse {
            let derived = move |at: usize| {
                let sample = self.samples[at];
                let next = self.samples.get(at + 1).filter(|next| next.pose_epoch == sample.pose_epoch);
                let twist = next.map(|next| speed(&sample.pose, &sample, next));
                plain(Sample { twist: sample.twist.or(twist), ..sample })
            };
            return Box::new((0..self.samples.len()).map(derived));
        }
        let last = self.samples.last().map(|last| plain(Sample { now_ns: last.stamp_ns, ..*last }));
        let filled = self.samples.windows(2).flat_map(move |pair| filled(pair[0], pair[1])).map(plain);
        Box::new(filled.chain(last))
    }
}

/// The samples at every 10 ms from one sample on, before the next.
fn filled(from: Sample, to: Sample) -> impl Iterator<Item = Sample> {
    // Nothing is made up across a gap, only what is needed to hold the pose over the frame at its beginning.
    let until_ns =
        if to.stamp_ns - from.stamp_ns > GAP_NS { from.stamp_ns + ODOMETRY_NS } else { to.stamp_ns };
    let first_ns = from.stamp_ns.next_multiple_of(ODOMETRY_NS);
    (first_ns..until_ns).step_by(ODOMETRY_NS as usize).map(move |stamp_ns| {
        if from.pose_epoch == to.pose_epoch {
            return from.between(&to, stamp_ns);
        }
        // An epoch begins half way.
        let near = if stamp_ns - from.stamp_ns < to.stamp_ns - stamp_ns { from } else { to };
        Sample { stamp_ns, now_ns: stamp_ns, ..near }
    })
}
