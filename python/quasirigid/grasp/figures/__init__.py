"""Pictures of a grasp, made of its recording."""
