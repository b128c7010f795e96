//! The tree of frames: who hangs on whom, which joints move, and where a sensor is in `base` at a time.

use crate::messages::TransformMessage;
use crate::rigid::Rigid;
use std::collections::BTreeMap;

/// Frames between a sensor and the root; a longer chain is a circle.
const DEPTH_MAX: usize = 64;
/// `[ns]` a pose this far from a time still says where things were then.
const HOLD_NS: u64 = 200_000_000;
/// `[ns]` between two poses this far apart nothing is known.
pub(crate) const GAP_NS: u64 = 1_000_000_000;

/// A frame without the slash that older programs put before it.
pub(crate) fn frame(name: &str) -> &str {
    name.trim_start_matches('/')
}

#[derive(Debug, Clone)]
struct Joint {
    parent: String,
    first: Rigid,
    moves: bool,
}

/// Which frame hangs on which.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tree {
    joints: BTreeMap<String, Joint>,
}

/// The joints between two frames: up from each to the frame that both hang on.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Route {
    from: Vec<String>,
    to: Vec<String>,
}

impl Tree {
    /// Learns from a message of `/tf` or `/tf_static`; what is no transform is passed over.
    pub(crate) fn learn(&mut self, message: &TransformMessage) {
        for stamped in &message.transforms {
            let (parent, child) = (frame(&stamped.header.frame_id), frame(&stamped.child_frame_id));
            let Some(rigid) = stamped.transform.rigid() else { continue };
            match self.joints.get_mut(child) {
                Some(joint) => joint.moves |= joint.first != rigid,
                None => {
                    let joint = Joint { parent: parent.to_owned(), first: rigid, moves: false };
                    self.joints.insert(child.to_owned(), joint);
                }
            }
        }
    }

    /// Whether a frame is known, as a parent or a child.
    pub(crate) fn knows(&self, name: &str) -> bool {
        self.joints.contains_key(name) || self.joints.values().any(|joint| joint.parent == name)
    }

    /// All frames, for a person.
    pub(crate) fn names(&self) -> String {
        let mut names: Vec<&str> = self.joints.keys().map(String::as_str).collect();
        names.extend(self.joints.values().map(|joint| joint.parent.as_str()));
        names.sort_unstable();
        names.dedup();
        if names.is_empty() { "no frame at all".into() } else { format!("frames {}", names.join(", ")) }
    }

    /// From a frame up to its root, the frame itself first.
    fn line<'a>(&'a self, name: &'a str) -> Vec<&'a str> {
        let mut line = vec![name];
        while let Some(joint) = self.joints.get(line[line.len() - 1]) {
            if line.len() > DEPTH_MAX {
                break;
            }
            line.push(&joint.parent);
        }
        line
    }

    /// The joints that place `to` in `from`; `None` where the two do not hang together.
    pub(crate) fn route(&self, from: &str, to: &str) -> Option<Route> {
        let (from_line, to_line) = (self.line(from), self.line(to));
        let (up, down) = to_line
            .iter()
            .enumerate()
            .find_map(|(up, name)| Some((up, from_line.iter().position(|other| other == name)?)))?;
        let names = |line: &[&str]| line.iter().map(|&name| name.to_owned()).collect();
        Some(Route { from: names(&from_line[..down]), to: names(&to_line[..up]) })
    }

    /// The joints of a route that move.
    pub(crate) fn moving<'a>(&'a self, route: &'a Route) -> impl Iterator<Item = &'a str> {
        let moves = |name: &&String| self.joints.get(*name).is_some_and(|joint| joint.moves);
        route.from.iter().chain(&route.to).filter(moves).map(String::as_str)
    }
}

/// Where the moving joints were, by time.
#[derive(Debug, Clone, Default)]
pub(crate) struct Motions {
    joints: BTreeMap<String, Vec<(u64, Rigid)>>,
}

impl Motions {
    /// Keeps the motion of these joints.
    pub(crate) fn of<'a>(joints: impl Iterator<Item = &'a str>) -> Self {
        Self { joints: joints.map(|name| (name.to_owned(), Vec::new())).collect() }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.joints.is_empty()
    }

    /// Takes what concerns the joints that are kept; `arrival_ns` replaces the stamps where it is given.
    pub(crate) fn learn(&mut self, message: &TransformMessage, arrival_ns: Option<u64>) {
        for stamped in &message.transforms {
            let Some(poses) = self.joints.get_mut(frame(&stamped.child_frame_id)) else { continue };
            let stamp_ns = arrival_ns.unwrap_or_else(|| stamped.header.stamp.ns());
            poses.extend(stamped.transform.rigid().map(|rigid| (stamp_ns, rigid)));
        }
    }

    /// Brings every motion into the order of time.
    pub(crate) fn sort(&mut self) {
        for poses in self.joints.values_mut() {
            poses.sort_by_key(|(stamp_ns, _)| *stamp_ns);
            poses.dedup_by_key(|(stamp_ns, _)| *stamp_ns);
        }
    }

    /// Times at which some joint was heard of.
    pub(crate) fn stamps(&self) -> Vec<u64> {
        let all = self.joints.values().flatten().map(|(stamp_ns, _)| *stamp_ns);
        let mut stamps: Vec<u64> = all.collect();
        stamps.sort_unstable();
        stamps.dedup();
        stamps
    }

    fn joint_at(&self, tree: &Tree, name: &str, stamp_ns: u64) -> Option<Rigid> {
        let Some(poses) = self.joints.get(name) else { return Some(tree.joints.get(name)?.first) };
        let after = poses.partition_point(|(at_ns, _)| *at_ns <= stamp_ns);
        let (before, next) = (after.checked_sub(1).map(|at| poses[at]), poses.get(after));
        match (before, next) {
            (Some((from_ns, from)), Some((to_ns, to))) if to_ns - from_ns <= GAP_NS => {
                Some(from.interpolate(to, (stamp_ns - from_ns) as f64 / (to_ns - from_ns) as f64))
            }
            (Some((from_ns, from)), _) if stamp_ns - from_ns <= HOLD_NS => Some(from),
            (_, Some((to_ns, to))) if to_ns - stamp_ns <= HOLD_NS => Some(*to),
            _ => None,
        }
    }

    /// Where the end of a route was, seen from its beginning; `None` where nothing is known of that time.
    pub(crate) fn at(&self, tree: &Tree, route: &Route, stamp_ns: u64) -> Option<Rigid> {
        let chain = |names: &[String]| {
            names.iter().try_fold(Rigid::IDENTITY, |child, name| {
                Some(self.joint_at(tree, name, stamp_ns)?.compose(&child))
            })
        };
        Some(chain(&route.from)?.inverse().compose(&chain(&route.to)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{Header, Time, Transform, TransformStamped, Vector3};

    fn joint(parent: &str, child: &str, stamp_ns: u64, x: f64) -> TransformMessage {
        let header = Header { stamp: Time::from_ns(stamp_ns), frame_id: parent.into() };
        let translation = Vector3 { x, ..Vector3::default() };
        let transform = Transform { translation, ..Transform::default() };
        TransformMessage {
            transforms: vec![TransformStamped { header, child_frame_id: child.into(), transform }],
        }
    }

    #[test]
    fn a_route_goes_up_to_the_frame_that_both_hang_on() {
        let mut tree = Tree::default();
        for message in
            [joint("/body", "base", 0, 1.0), joint("body", "mast", 0, 5.0), joint("mast", "camera", 0, 0.5)]
        {
            tree.learn(&message);
        }
        let route = tree.route("base", "camera").unwrap();
        let at = Motions::default().at(&tree, &route, 7).unwrap();
        assert!((at.translation_m[0] - 4.5).abs() < 1e-12, "{at:?}");
        assert_eq!(tree.route("base", "lamp"), None);
        assert_eq!(tree.moving(&route).count(), 0);
        // A circle ends.
        tree.learn(&joint("camera", "body", 0, 0.0));
        assert!(tree.route("lamp", "camera").is_none());
    }

    #[test]
    fn a_moving_joint_is_interpolated_and_not_believed_across_a_gap() {
        let mut tree = Tree::default();
        let messages = [(1.0, 0.0), (1.1, 1.0), (9.0, 2.0)]
            .map(|(at_s, x)| joint("base", "camera", (at_s * 1e9) as u64, x));
        messages.iter().for_each(|message| tree.learn(message));
        let route = tree.route("base", "camera").unwrap();
        let mut motions = Motions::of(tree.moving(&route));
        messages.iter().rev().for_each(|message| motions.learn(message, None));
        motions.sort();
        let x = |at_ns: u64| motions.at(&tree, &route, at_ns).map(|rigid| rigid.translation_m[0]);
        assert!((x(1_050_000_000).unwrap() - 0.5).abs() < 1e-9);
        assert_eq!((x(1_250_000_000), x(5_000_000_000), x(8_900_000_000)), (Some(1.0), None, Some(2.0)));
    }
}
