//! Whether a frame can be believed at all, and where its pixels lie in `base`.

use sidestep_msgs::{DepthFrame, Status};

/// `[m]` farthest a camera may be mounted from the axle; beyond, the pose is garbage.
const MOUNT_MAX_M: f32 = 5.0;

/// Whether a frame can be used; [`Status::Ok`] if so.
pub(crate) fn refusal(frame: &DepthFrame, valid_part_min: f32) -> Status {
    let sized = (16..=640).contains(&frame.width) && (16..=480).contains(&frame.height);
    let scaled = frame.metres_per_unit > 0.0 && frame.metres_per_unit <= 0.1;
    let focal = [frame.fx_px, frame.fy_px].iter().all(|focal_px| (8.0..1e5).contains(focal_px));
    let centred = [frame.cx_px, frame.cy_px].iter().all(|centre_px| centre_px.abs() < 1e4);
    if !(sized && scaled && focal && centred) {
        return Status::RefusedShape;
    }
    let mounted = frame.camera.translation_m.iter().all(|part_m| part_m.abs() < MOUNT_MAX_M);
    if !(frame.camera.is_valid() && mounted) {
        return Status::RefusedPose;
    }
    if frame.capture_ns == 0 {
        return Status::RefusedStamp;
    }
    let pixels = frame.used_pixels();
    let measured = pixels.iter().map(|&raw| u32::from(raw != 0 && raw != u16::MAX)).sum::<u32>();
    if measured as f32 >= (valid_part_min * pixels.len() as f32).max(1.0) {
        return Status::Ok;
    }
    let saturated = pixels.iter().filter(|&&raw| raw == u16::MAX).count();
    if 2 * saturated > pixels.len() { Status::RefusedSaturated } else { Status::RefusedEmpty }
}

/// A frame's camera in `base` of a level robot: `point = eye + depth * ray`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lens {
    rotation: [[f32; 3]; 3],
    /// `[m]` the camera.
    pub(crate) eye_m: [f32; 3],
    focal_px: [f32; 2],
    centre_px: [f32; 2],
}

impl Lens {
    pub(crate) fn new(frame: &DepthFrame) -> Self {
        Self {
            rotation: frame.camera.rotation(),
            eye_m: frame.camera.translation_m,
            focal_px: [frame.fx_px, frame.fy_px],
            centre_px: [frame.cx_px, frame.cy_px],
        }
    }

    /// Direction of a pixel's ray per metre of depth.
    pub(crate) fn ray(&self, column_px: f32, row_px: f32) -> [f32; 3] {
        let x = (column_px - self.centre_px[0]) / self.focal_px[0];
        let y = (row_px - self.centre_px[1]) / self.focal_px[1];
        self.rotation.map(|part| part[0] * x + part[1] * y + part[2])
    }

    /// Change of the ray from one column to the next: along a row the ray is affine in the column.
    pub(crate) fn per_column(&self) -> [f32; 3] {
        self.rotation.map(|part| part[0] / self.focal_px[0])
    }

    /// `[rad]` bearing of the optical axis; 0 for a camera that looks straight down.
    pub(crate) fn axis_rad(&self) -> f32 {
        libm::atan2f(self.rotation[1][2], self.rotation[0][2])
    }
}
