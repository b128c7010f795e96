//! Robots for tests: the files that the graph uses.

use sidestep_msgs::Robot;

pub(crate) fn loomo() -> Robot {
    Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml")).unwrap()
}

pub(crate) fn jackal() -> Robot {
    Robot::from_toml("jackal.toml", include_str!("../../../launch/robots/jackal.toml")).unwrap()
}
