"""The metrics of the evaluation that a reader of the report wants, in words."""

METRIC_WORDS = {
    "mpjpe": "Joint positions, each frame aligned",
    "mpjpe_true_body": "Joint positions, on a body of true lengths",
    "mpjae": "Orientations of the segments",
    "mpjae_local": "Joint rotations",
    "knee_flexion_rmse": "Knee flexion",
    "knee_flexion_rmse_without_offset": "Knee flexion, mean difference removed",
    "scene_position_error": "Joint positions in the room",
    "yaw_aligned_position_error": "Joint positions, the whole turned and shifted once",
    "root_translation_error": "Path of the pelvis",
    "root_translation_error_percent": "Path of the pelvis, of its length",
    "length_error": "Lengths of the body",
    "heading_error": "Headings of the sensors",
    "mounting_error": "Mountings of the sensors",
    "camera_translation": "Place of the camera",
    "camera_rotation": "Orientation of the camera",
    "time_offset_error": "Clock of the video",
    "association_precision": "Detections given to the right person",
    "association_recall": "Detections of wearers that were used",
    "nees_joints": "Honesty of the ± of joint rotations: 1 is right, above 1 too sure",
    "coverage_95_joints": "Share of joint rotations within their 95 % range",
}
