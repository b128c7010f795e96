//! The definitions of the ROS 2 messages that an export writes, as `ros2msg` schemas have them: each with all that it
//! is made of.

/// Between two definitions of one schema.
const SEPARATOR: &str = "================================================================================\n";

/// Fields and constants of each message, by its name without `msg/`.
const DEFINITIONS: &[(&str, &str)] = &[
    ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"),
    ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"),
    ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"),
    ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"),
    ("geometry_msgs/Quaternion", "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n"),
    ("geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"),
    ("geometry_msgs/PoseWithCovariance", "geometry_msgs/Pose pose\nfloat64[36] covariance\n"),
    ("geometry_msgs/PoseStamped", "std_msgs/Header header\ngeometry_msgs/Pose pose\n"),
    ("geometry_msgs/Twist", "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n"),
    ("geometry_msgs/TwistWithCovariance", "geometry_msgs/Twist twist\nfloat64[36] covariance\n"),
    ("geometry_msgs/TwistStamped", "std_msgs/Header header\ngeometry_msgs/Twist twist\n"),
    ("geometry_msgs/Transform", "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"),
    (
        "geometry_msgs/TransformStamped",
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
    ),
    ("tf2_msgs/TFMessage", "geometry_msgs/TransformStamped[] transforms\n"),
    (
        "nav_msgs/Odometry",
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n\
         geometry_msgs/TwistWithCovariance twist\n",
    ),
    (
        "nav_msgs/MapMetaData",
        "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\nuint32 height\n\
         geometry_msgs/Pose origin\n",
    ),
    ("nav_msgs/OccupancyGrid", "std_msgs/Header header\nnav_msgs/MapMetaData info\nint8[] data\n"),
    ("nav_msgs/Path", "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses\n"),
    (
        "sensor_msgs/Image",
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n\
         uint8[] data\n",
    ),
    (
        "sensor_msgs/RegionOfInterest",
        "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n",
    ),
    (
        "sensor_msgs/CameraInfo",
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n\
         float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n",
    ),
    (
        "sensor_msgs/LaserScan",
        "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\n\
         float32 time_increment\nfloat32 scan_time\nfloat32 range_min\nfloat32 range_max\nfloat32[] ranges\n\
         float32[] intensities\n",
    ),
];

fn definition(name: &str) -> &'static str {
    DEFINITIONS.iter().find(|(known, _)| *known == name).map_or("", |(_, text)| text)
}

/// Full name and text of a message's schema.
pub(crate) fn schema(name: &str) -> (String, String) {
    let mut parts = vec![name];
    let mut text = String::new();
    let mut at = 0;
    while at < parts.len() {
        let body = definition(parts[at]);
        if at > 0 {
            text.push_str(&format!("{SEPARATOR}MSG: {}\n", parts[at]));
        }
        text.push_str(body);
        for field in body.lines().filter_map(|line| line.split(['[', ' ']).next()) {
            if field.contains('/') && !parts.contains(&field) {
                parts.push(field);
            }
        }
        at += 1;
    }
    (name.replace('/', "/msg/"), text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_schema_defines_all_that_it_names() {
        for (name, _) in DEFINITIONS {
            let (full, text) = schema(name);
            assert!(full.contains("/msg/"), "{full}");
            for field in text.lines().filter_map(|line| line.split(['[', ' ']).next()) {
                if field.contains('/') {
                    assert!(!definition(field).is_empty(), "{name}: no definition of {field}");
                    assert_eq!(text.matches(&format!("MSG: {field}\n")).count(), 1, "{name}: {field}");
                }
            }
        }
        assert!(
            schema("nav_msgs/Path")
                .1
                .starts_with("std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses\n===")
        );
    }
}
