//! What stands in the way, and what is wrong with the sight of it.

/// What stands, or is missing, in the way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Thing {
    /// Free floor.
    Nothing,
    /// A standing pole of 2 cm, 1 m high.
    Pole,
    /// A table top of 1.2 m by 0.6 m at 0.70 to 0.74 m, open below: the simulator's tables, without their legs.
    Board,
    /// A box of 0.3 m by 0.3 m that faces the robot.
    Box {
        /// `[m]`
        height_m: f64,
    },
    /// A pane of 1 m by 1 cm, 2 m high.
    Pane,
    /// Eight steps down of 0.17 m by 0.28 m, as wide as the hall.
    Stairs,
}

/// What is wrong with the sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Fault {
    /// Nothing but the noise of the stereo camera.
    None,
    /// So much of what the thing returns is lost.
    Black {
        /// `[1]` share of pixels.
        lost: f64,
    },
    /// The thing returns nothing, and what stands behind it is seen through it.
    Clear,
    /// So much of the whole image is lost.
    Dropout {
        /// `[1]` share of pixels.
        lost: f64,
    },
    /// The camera looks lower than its mounting says; negative: higher.
    Pitched {
        /// `[degree]`
        down: f64,
    },
}

/// One row of the measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Class {
    /// What it is called in tables.
    pub name: &'static str,
    pub(crate) thing: Thing,
    pub(crate) fault: Fault,
}

impl Class {
    /// Whether anything stands or is missing there; if not, whatever is marked is marked falsely.
    #[must_use]
    pub fn is_object(&self) -> bool {
        self.thing != Thing::Nothing
    }
}

const fn class(name: &'static str, thing: Thing, fault: Fault) -> Class {
    Class { name, thing, fault }
}

const fn cube(height_m: f64) -> Thing {
    Thing::Box { height_m }
}

const fn down(degree: f64) -> Fault {
    Fault::Pitched { down: degree }
}

/// Every class, in the order of the table.
pub const CLASSES: [Class; 19] = [
    class("pole, 2 cm", Thing::Pole, Fault::None),
    class("table edge, 0.70 m", Thing::Board, Fault::None),
    class("box, 5 cm", cube(0.05), Fault::None),
    class("box, 10 cm", cube(0.1), Fault::None),
    class("box, 20 cm", cube(0.2), Fault::None),
    class("box, 30 cm", cube(0.3), Fault::None),
    class("box, 20 cm, black: 95 % of it lost", cube(0.2), Fault::Black { lost: 0.95 }),
    class("glass pane", Thing::Pane, Fault::Clear),
    class("stairs down", Thing::Stairs, Fault::None),
    class("box, 20 cm, 30 % of all pixels lost", cube(0.2), Fault::Dropout { lost: 0.3 }),
    class("box, 10 cm, camera 3 degrees low", cube(0.1), down(3.0)),
    class("box, 10 cm, camera 3 degrees high", cube(0.1), down(-3.0)),
    class("box, 10 cm, camera 5 degrees low", cube(0.1), down(5.0)),
    class("box, 10 cm, camera 5 degrees high", cube(0.1), down(-5.0)),
    class("nothing", Thing::Nothing, Fault::None),
    class("nothing, camera 3 degrees low", Thing::Nothing, down(3.0)),
    class("nothing, camera 3 degrees high", Thing::Nothing, down(-3.0)),
    class("nothing, camera 5 degrees low", Thing::Nothing, down(5.0)),
    class("nothing, camera 5 degrees high", Thing::Nothing, down(-5.0)),
];
