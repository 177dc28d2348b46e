"""A webcam of this computer, watched only while a session asks for it. Pictures are not kept."""

from __future__ import annotations

import logging
import threading
import time
from pathlib import Path

import cv2
import numpy as np

from rcare_marl.agents.coaching.sources.landmark_source import LandmarkReading, PoseDetector
from rcare_marl.errors import ConfigError

UNASKED = 3.0  # after so long without a question the camera is let go [s]; our own choice

logger = logging.getLogger(__name__)


class Webcam:
    """Finds landmarks in what a webcam sees, in a thread of its own."""

    def __init__(self, detector: PoseDetector, device: int | str = 0) -> None:
        """Prepare a camera; it is opened when somebody asks.

        Args:
            detector: Finds the landmarks.
            device: Number of the camera, or a video file.
        """
        self._detector, self._device = detector, device
        self._lock = threading.Lock()
        self._newest: tuple[LandmarkReading, float] | None = None
        self._asked_at = 0.0
        self._thread: threading.Thread | None = None

    @classmethod
    def of_model(cls, model: str | Path, device: int | str = 0) -> Webcam:
        """Return a webcam with MediaPipe's pose landmarker.

        Raises:
            ConfigError: If there is no such model, or no such camera.
            MissingPackageError: If MediaPipe is not installed.
        """
        detector = PoseDetector(model)
        capture = cv2.VideoCapture(device)
        opened = capture.isOpened()
        capture.release()
        if not opened:
            raise ConfigError(f"no camera {device} can be opened")
        return cls(detector, device)

    def newest(self) -> tuple[LandmarkReading, float] | None:
        """Return what was found since the last call, and when [s]; None if nothing was."""
        with self._lock:
            self._asked_at = time.monotonic()
            if self._thread is None or not self._thread.is_alive():
                self._thread = threading.Thread(target=self._watch, daemon=True)
                self._thread.start()
            out, self._newest = self._newest, None
        return out

    def _watch(self) -> None:
        capture = cv2.VideoCapture(self._device)
        try:
            while time.monotonic() - self._asked_at < UNASKED:
                seen, image = capture.read()
                if not seen:
                    logger.warning("the camera %s shows nothing", self._device)
                    return
                now = time.monotonic()
                found = self._detector.detect(np.ascontiguousarray(image[:, :, ::-1]), now)
                if found is not None:
                    with self._lock:
                        self._newest = (found, now)
        finally:
            capture.release()
