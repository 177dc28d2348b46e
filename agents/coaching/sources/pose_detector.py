"""Body landmarks in pictures of a webcam or a video, found by MediaPipe, which is optional.

MediaPipe is imported when a detector is made and not before. It asks for the package opencv-contrib-python,
which fills the same folder as the opencv-python-headless of this project; so it is installed by itself
beside the extra `webcam`, which has the rest of what it needs.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rcare_marl.errors import ConfigError, MissingPackageError

from .landmark_source import LandmarkReading

INSTALL = "'rcare-marl[webcam]' && pip install --no-deps mediapipe==1.2.2"
MODEL = "pose_landmarker_full.task"


class PoseDetector:
    """Finds the landmarks of one person, picture after picture. Close it in the end."""

    def __init__(self, model: str | Path) -> None:
        """Open a model.

        Args:
            model: A file of MediaPipe's pose landmarker, such as `pose_landmarker_full.task` of Google's
                model page; none is shipped with this project.

        Raises:
            ConfigError: If there is no such file, or it is no such model.
            MissingPackageError: If MediaPipe is not installed.
        """
        path = Path(model)
        if not path.is_file():
            raise ConfigError(
                f"no model of a pose landmarker at {path}: download {MODEL} from MediaPipe's page on pose "
                "landmark detection and say where it is"
            )
        try:
            import mediapipe  # type: ignore[import-not-found, import-untyped, unused-ignore]
            from mediapipe.tasks.python import (  # type: ignore[import-not-found, import-untyped, unused-ignore]
                BaseOptions,
                vision,
            )
        except ImportError as error:
            raise MissingPackageError("finding a pose in a webcam", package=INSTALL) from error
        options = vision.PoseLandmarkerOptions(
            base_options=BaseOptions(model_asset_path=str(path)),
            running_mode=vision.RunningMode.VIDEO,
        )
        self._mediapipe: Any = mediapipe
        try:
            self._landmarker: Any = vision.PoseLandmarker.create_from_options(options)
        except (RuntimeError, ValueError) as error:
            raise ConfigError(f"{path} is no model of a pose landmarker: {error}") from error

    def detect(self, image: npt.NDArray[np.uint8], time: float) -> LandmarkReading | None:
        """Return the landmarks in a picture, None if nobody is seen.

        Args:
            image: Colours (RGB), shape [height, width, 3].
            time: [s]; it must grow by a millisecond at least from picture to picture.
        """
        picture = self._mediapipe.Image(
            image_format=self._mediapipe.ImageFormat.SRGB, data=np.ascontiguousarray(image)
        )
        found = self._landmarker.detect_for_video(picture, round(1000 * time))
        if not found.pose_world_landmarks:
            return None
        marks = found.pose_world_landmarks[0]
        return LandmarkReading(
            np.array([(mark.x, mark.y, mark.z) for mark in marks], np.float64),
            np.array([mark.visibility for mark in marks], np.float64),
        )

    def close(self) -> None:
        """Free the model."""
        self._landmarker.close()
