//! Robots for tests: the files that the graph uses.

use sidestep_msgs::Robot;

pub(crate) fn loomo() -> Robot {
    Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml")).unwrap()
}

pub(crate) fn jackal() -> Robot {
    Robot::from_toml("jackal.toml", include_str!("../../../launch/robots/jackal.toml")).unwrap()
}

/// The folder of real data, or `None` with a line that says so.
pub(crate) fn data_folder(test: &str) -> Option<std::path::PathBuf> {
    std::env::var_os("SIDESTEP_DATA").map(Into::into).or_else(|| {
        println!("skipped: SIDESTEP_DATA is not set ({test})");
        None
    })
}
