"""Pictures of segments on images, depth, and predictions beside the ground truth."""
