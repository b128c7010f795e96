//! A drive as the recorder receives it: dense and rare topics, small and large messages.

use sidestep_msgs::{
    CLOCK, COMMAND, Clock, Command, DEPTH, DepthFrame, GOAL_STATE_BYTES, Header, ODOMETRY, Odometry, PATH,
    Path, STATE_GOAL, TopicRow,
};

pub(crate) const SECOND_NS: u64 = 1_000_000_000;

/// One message on its way to the recorder.
#[derive(Debug, Clone)]
pub(crate) struct Said {
    pub(crate) row: &'static TopicRow,
    pub(crate) header: Header,
    pub(crate) message: Vec<u8>,
    pub(crate) received_ns: u64,
}

impl Said {
    pub(crate) fn new(row: &'static TopicRow, sequence: u64, message: Vec<u8>, received_ns: u64) -> Self {
        let header = Header { run: 7, sequence, now_ns: received_ns, ..Header::default() };
        Self { row, header, message, received_ns }
    }

    /// Header and message, one after the other.
    pub(crate) fn record(&self) -> Vec<u8> {
        [bytemuck::bytes_of(&self.header), &self.message].concat()
    }
}

/// SplitMix64.
pub(crate) fn draw(seed: &mut u64) -> u64 {
    *seed = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *seed;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A depth frame whose pixels lie on slopes with noise of a few millimetres, as a camera's.
pub(crate) fn depth(width: u32, height: u32, seed: &mut u64) -> Vec<u8> {
    let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
    (frame.width, frame.height, frame.metres_per_unit) = (width, height, 0.001);
    let used = width as usize * height as usize;
    for (i, pixel) in frame.pixels[..used].iter_mut().enumerate() {
        let (column, row) = (i % width as usize, i / width as usize);
        let noise = draw(seed) % 8;
        *pixel = (800 + 3 * row + column / 4) as u16 + noise as u16;
    }
    bytemuck::bytes_of(&*frame).to_vec()
}

/// Seconds of odometry and commands at 50 Hz, small frames at 10 Hz, clock at 1 Hz, one path, a state every 10 s.
pub(crate) fn drive(mut seed: u64, seconds: u64) -> Vec<Said> {
    let mut made = Vec::new();
    for tick in 1..=50 * seconds {
        let at_ns = tick * SECOND_NS / 50;
        let mut say = |row: &'static TopicRow, message: Vec<u8>| {
            let sequence = made.iter().rev().find(|said: &&Said| said.row.index == row.index);
            let sequence = sequence.map_or(0, |said| said.header.sequence) + 1;
            made.push(Said::new(row, sequence, message, at_ns));
        };
        if tick == 3 {
            say(PATH.row(), vec![7; size_of::<Path>()]);
        }
        if tick % 50 == 1 {
            say(CLOCK.row(), vec![tick as u8; size_of::<Clock>()]);
        }
        say(ODOMETRY.row(), vec![draw(&mut seed) as u8; size_of::<Odometry>()]);
        if tick % 5 == 0 {
            say(DEPTH.row(), depth(160, 120, &mut seed));
        }
        say(COMMAND.row(), bytemuck::bytes_of(&<Command as bytemuck::Zeroable>::zeroed()).to_vec());
        if tick % 500 == 1 {
            say(STATE_GOAL.row(), vec![tick as u8; GOAL_STATE_BYTES + 16]);
        }
    }
    made
}
