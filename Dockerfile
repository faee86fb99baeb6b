# docker build -t lowcostnav_ros .
# docker run --rm --shm-size=512m -p 127.0.0.1:8040:8040 lowcostnav_ros up livermore --listen 0.0.0.0:8040 --no-table
# With sensors of this machine: docker run --rm --network host --ipc host -v "$PWD/flights:/flights" lowcostnav_ros up navigators_only --out /flights/1
FROM python:3.12-slim AS build
RUN apt-get update && apt-get install -y --no-install-recommends gcc && rm -rf /var/lib/apt/lists/*
WORKDIR /source
COPY . .
RUN python -m venv /opt/lowcostnav && /opt/lowcostnav/bin/pip install --no-cache-dir -r requirements.txt \
    && /opt/lowcostnav/bin/pip install --no-cache-dir --no-deps .

FROM python:3.12-slim
RUN useradd --create-home --uid 1000 pilot && install -d -o pilot /flights
COPY --from=build /opt/lowcostnav /opt/lowcostnav
ENV PATH=/opt/lowcostnav/bin:$PATH AMENT_PREFIX_PATH=/opt/lowcostnav PYTHONUNBUFFERED=1
USER pilot
WORKDIR /flights
ENTRYPOINT ["lowcostnav"]
CMD ["doctor"]
