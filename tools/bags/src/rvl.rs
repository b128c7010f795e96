//! RVL, run length and variable length (A. Wilson, 2017): lossless depth in groups of three bits.

/// Columns, rows and the rest of an RVL body.
pub(crate) fn size(body: &[u8]) -> Option<(usize, usize, &[u8])> {
    let (head, rest) = body.split_at_checked(8)?;
    let number = |at: usize| u32::from_le_bytes([0, 1, 2, 3].map(|i| head[at + i])) as usize;
    Some((number(0), number(4), rest))
}

/// Groups of three bits with a mark that more follow, packed into words, the first in the highest bits.
struct Nibbles<'a> {
    words: std::slice::ChunksExact<'a, u8>,
    word: u32,
    left: u32,
}

impl Nibbles<'_> {
    fn number(&mut self) -> Option<u32> {
        let mut value = 0;
        for place in 0..11 {
            if self.left == 0 {
                let word = self.words.next()?;
                (self.word, self.left) = (u32::from_le_bytes([word[0], word[1], word[2], word[3]]), 8);
            }
            let nibble = self.word >> 28;
            self.word <<= 4;
            self.left -= 1;
            value |= (nibble & 7).checked_shl(3 * place)?;
            if nibble & 8 == 0 {
                return Some(value);
            }
        }
        None
    }
}

/// Fills all pixels; `None` where the body ends early or says more pixels than there are.
pub(crate) fn decode(body: &[u8], pixels: &mut [u16]) -> Option<()> {
    let mut nibbles = Nibbles { words: body.chunks_exact(4), word: 0, left: 0 };
    let (mut at, mut previous) = (0, 0u16);
    while at < pixels.len() {
        let zeros = nibbles.number()? as usize;
        pixels.get_mut(at..at.checked_add(zeros)?)?.fill(0);
        at += zeros;
        let values = nibbles.number()? as usize;
        if zeros + values == 0 {
            return None;
        }
        for pixel in pixels.get_mut(at..at.checked_add(values)?)? {
            let folded = nibbles.number()?;
            // Even = up, odd = down.
            let delta = (folded >> 1) as i32 ^ -((folded & 1) as i32);
            previous = previous.wrapping_add(delta as u16);
            *pixel = previous;
        }
        at += values;
    }
    Some(())
}
