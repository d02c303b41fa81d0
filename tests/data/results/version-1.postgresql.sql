\restrict eGcEEYTmOXeDcLwJjeTcdmfmfHE62CZRLGpuJGAfdZpF9aBOm48w3Xb8GMm9FCZ
SET statement_timeout = 0;
SET lock_timeout = 0;
SET idle_in_transaction_session_timeout = 0;
SET client_encoding = 'UTF8';
SET standard_conforming_strings = on;
SELECT pg_catalog.set_config('search_path', '', false);
SET check_function_bodies = false;
SET xmloption = content;
SET client_min_messages = warning;
SET row_security = off;
CREATE FUNCTION public.ps4rig_append_only() RETURNS trigger
    LANGUAGE plpgsql
    AS $$
BEGIN
    RAISE EXCEPTION USING MESSAGE = TG_TABLE_NAME || ': rows are never changed or deleted';
END $$;
SET default_tablespace = '';
SET default_table_access_method = heap;
CREATE TABLE public.begun_parts (
    station text NOT NULL,
    part_id text NOT NULL,
    number bigint NOT NULL,
    request text NOT NULL,
    trigger text NOT NULL,
    triggered_utc text NOT NULL,
    simulated boolean NOT NULL
);
CREATE TABLE public.overrides (
    station text NOT NULL,
    part_id text NOT NULL,
    "position" bigint NOT NULL,
    request text NOT NULL,
    utc text NOT NULL,
    decision text NOT NULL,
    by text NOT NULL,
    reason text NOT NULL
);
CREATE TABLE public.refused_triggers (
    station text NOT NULL,
    "position" bigint NOT NULL,
    request text NOT NULL,
    utc text NOT NULL,
    trigger text NOT NULL,
    part_id text,
    reason text NOT NULL,
    simulated boolean NOT NULL
);
CREATE TABLE public.results (
    station text NOT NULL,
    part_id text NOT NULL,
    number bigint NOT NULL,
    trigger text NOT NULL,
    triggered_utc text NOT NULL,
    exposed_utc text,
    decided_utc text NOT NULL,
    decision text NOT NULL,
    reason text NOT NULL,
    causes json NOT NULL,
    operator text,
    simulated boolean NOT NULL,
    software_version text NOT NULL,
    recipe text,
    recipe_version bigint,
    recipe_sha256 text,
    library_sha256 text,
    calibration_sha256 text,
    set_file text,
    set_sha256 text,
    label text,
    nearest text,
    orientation_deg double precision,
    distance double precision,
    "limit" double precision,
    margin double precision,
    blur_px double precision,
    sdq double precision,
    shadow_fraction double precision,
    defect_score double precision,
    defects json NOT NULL,
    led_levels json NOT NULL,
    timings_ms json NOT NULL,
    notes json NOT NULL
);
CREATE TABLE public.schema_versions (
    version integer NOT NULL,
    since_utc text NOT NULL,
    software_version text NOT NULL
);
CREATE TABLE public.stations (
    station text NOT NULL,
    since_utc text NOT NULL
);
INSERT INTO public.begun_parts VALUES ('line-1', 'part-000001', 1, 'a0f8920c75d3408eb21fc0bf228e5e09', 'timer', '2026-11-20T08:00:00.042Z', false);
INSERT INTO public.begun_parts VALUES ('line-1', 'part-000002', 2, 'ae234b3dd3964f568a5f605b94f12dcc', 'timer', '2026-11-20T08:01:00.042Z', false);
INSERT INTO public.begun_parts VALUES ('line-1', 'A-17', 3, 'db4e0961463944a5a8dc4d5bd52dbdf6', 'timer', '2026-11-20T08:02:00.042Z', false);
INSERT INTO public.begun_parts VALUES ('line-1', 'part-000004', 4, '0488ba8abe7c4f239932a0fb6a13bc6f', 'timer', '2026-11-21T08:03:00.042Z', false);
INSERT INTO public.begun_parts VALUES ('line-1', 'part-000005', 5, 'a0b2b8b14f554a9aaee25192be8e178e', 'timer', '2026-11-21T08:04:00.042Z', true);
INSERT INTO public.begun_parts VALUES ('line-1', 'part-000006', 6, '1853cc8ee0344ce194d97cf2bee57b11', 'enter', '2026-11-22T09:00:00.000Z', false);
INSERT INTO public.overrides VALUES ('line-1', 'part-000002', 1, '5c400a2b2358469e909bf7dd05806f3a', '2026-11-22T10:00:00.000Z', 'PASS', 'Kim', 'a hair, blown away');
INSERT INTO public.refused_triggers VALUES ('line-1', 1, 'b0e8ce6f64284b8388879122c962b78d', '2026-11-22T09:00:00.100Z', 'enter', NULL, 'no buffer', false);
INSERT INTO public.results VALUES ('line-1', 'part-000001', 1, 'timer', '2026-11-20T08:00:00.042Z', '2026-11-20T08:00:00.442Z', '2026-11-20T08:00:00.542Z', 'PASS', 'oak at 0.25 of its limit', '[]', 'Jo Müller', false, '0.1.0', 'oak', 3, 'aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa', 'bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb', NULL, 'parts/2026-11-20/part-000001.ome.tif', '0000000000000000000000000000000000000000000000000000000000000000', 'oak', 'oak', 12.5, 0.25, 1, 0.5, 0.1, 0.3, 0.02, NULL, '[]', '[1.0, 0.99, 1.01, 1.0]', '{"inspect": 40.5}', '[]');
INSERT INTO public.results VALUES ('line-1', 'part-000002', 2, 'timer', '2026-11-20T08:01:00.042Z', '2026-11-20T08:01:00.442Z', '2026-11-20T08:01:00.542Z', 'FAIL', 'a scratch of 120 px', '["defect"]', 'Jo Müller', false, '0.1.0', 'oak', 3, 'aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa', 'bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb', NULL, 'parts/2026-11-20/part-000002.ome.tif', '0000000000000000000000000000000000000000000000000000000000000001', 'oak', 'oak', 12.5, 0.25, 1, 0.5, 0.1, 0.3, 0.02, 2.5, '[{"kind": "relief", "row": 10, "column": 20, "height": 8, "width": 60, "area_px": 120, "score": 2.5}]', '[1.0, 0.99, 1.01, 1.0]', '{"inspect": 40.5}', '[]');
INSERT INTO public.results VALUES ('line-1', 'A-17', 3, 'timer', '2026-11-20T08:02:00.042Z', '2026-11-20T08:02:00.442Z', '2026-11-20T08:02:00.542Z', 'PASS', 'oak at 0.30 of its limit', '[]', 'Jo Müller', false, '0.1.0', 'oak', 3, 'aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa', 'bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb', NULL, 'parts/2026-11-20/A-17.ome.tif', '0000000000000000000000000000000000000000000000000000000000000002', 'oak', 'oak', 12.5, 0.25, 1, 0.5, 0.1, 0.3, 0.02, NULL, '[]', '[1.0, 0.99, 1.01, 1.0]', '{"inspect": 40.5}', '[]');
INSERT INTO public.results VALUES ('line-1', 'part-000004', 4, 'timer', '2026-11-21T08:03:00.042Z', '2026-11-21T08:03:00.442Z', '2026-11-21T08:03:00.542Z', 'UNKNOWN', 'like nothing taught', '["no-texture"]', 'Jo Müller', false, '0.1.0', 'oak', 3, 'aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa', 'bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb', NULL, 'parts/2026-11-21/part-000004.ome.tif', '0000000000000000000000000000000000000000000000000000000000000003', 'oak', 'oak', 12.5, 0.25, 1, 0.5, 0.1, 0.3, 0.02, NULL, '[]', '[1.0, 0.99, 1.01, 1.0]', '{"inspect": 40.5}', '[]');
INSERT INTO public.results VALUES ('line-1', 'part-000005', 5, 'timer', '2026-11-21T08:04:00.042Z', '2026-11-21T08:04:00.442Z', '2026-11-21T08:04:00.542Z', 'PASS', 'oak at 0.20 of its limit', '[]', 'Jo Müller', true, '0.1.0', 'oak', 3, 'aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa', 'bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb', NULL, 'parts/2026-11-21/part-000005.ome.tif', '0000000000000000000000000000000000000000000000000000000000000004', 'oak', 'oak', 12.5, 0.25, 1, 0.5, 0.1, 0.3, 0.02, NULL, '[]', '[1.0, 0.99, 1.01, 1.0]', '{"inspect": 40.5}', '["the clock was set back"]');
INSERT INTO public.schema_versions VALUES (1, '2026-11-22T17:22:18.746Z', '0.1.0');
INSERT INTO public.stations VALUES ('line-1', '2026-11-20T08:00:00.042Z');
ALTER TABLE ONLY public.begun_parts
    ADD CONSTRAINT begun_parts_pkey PRIMARY KEY (station, part_id);
ALTER TABLE ONLY public.begun_parts
    ADD CONSTRAINT begun_parts_request_key UNIQUE (request);
ALTER TABLE ONLY public.begun_parts
    ADD CONSTRAINT begun_parts_station_number_key UNIQUE (station, number);
ALTER TABLE ONLY public.begun_parts
    ADD CONSTRAINT begun_parts_station_part_id_number_key UNIQUE (station, part_id, number);
ALTER TABLE ONLY public.overrides
    ADD CONSTRAINT overrides_pkey PRIMARY KEY (station, part_id, "position");
ALTER TABLE ONLY public.overrides
    ADD CONSTRAINT overrides_request_key UNIQUE (request);
ALTER TABLE ONLY public.refused_triggers
    ADD CONSTRAINT refused_triggers_pkey PRIMARY KEY (station, "position");
ALTER TABLE ONLY public.refused_triggers
    ADD CONSTRAINT refused_triggers_request_key UNIQUE (request);
ALTER TABLE ONLY public.results
    ADD CONSTRAINT results_pkey PRIMARY KEY (station, part_id);
ALTER TABLE ONLY public.results
    ADD CONSTRAINT results_station_number_key UNIQUE (station, number);
ALTER TABLE ONLY public.schema_versions
    ADD CONSTRAINT schema_versions_pkey PRIMARY KEY (version);
ALTER TABLE ONLY public.stations
    ADD CONSTRAINT stations_pkey PRIMARY KEY (station);
CREATE TRIGGER begun_parts_append_only BEFORE DELETE OR UPDATE OR TRUNCATE ON public.begun_parts FOR EACH STATEMENT EXECUTE FUNCTION public.ps4rig_append_only();
CREATE TRIGGER overrides_append_only BEFORE DELETE OR UPDATE OR TRUNCATE ON public.overrides FOR EACH STATEMENT EXECUTE FUNCTION public.ps4rig_append_only();
CREATE TRIGGER refused_triggers_append_only BEFORE DELETE OR UPDATE OR TRUNCATE ON public.refused_triggers FOR EACH STATEMENT EXECUTE FUNCTION public.ps4rig_append_only();
CREATE TRIGGER results_append_only BEFORE DELETE OR UPDATE OR TRUNCATE ON public.results FOR EACH STATEMENT EXECUTE FUNCTION public.ps4rig_append_only();
CREATE TRIGGER schema_versions_append_only BEFORE DELETE OR UPDATE OR TRUNCATE ON public.schema_versions FOR EACH STATEMENT EXECUTE FUNCTION public.ps4rig_append_only();
CREATE TRIGGER stations_append_only BEFORE DELETE OR UPDATE OR TRUNCATE ON public.stations FOR EACH STATEMENT EXECUTE FUNCTION public.ps4rig_append_only();
ALTER TABLE ONLY public.begun_parts
    ADD CONSTRAINT begun_parts_station_fkey FOREIGN KEY (station) REFERENCES public.stations(station);
ALTER TABLE ONLY public.overrides
    ADD CONSTRAINT overrides_station_part_id_fkey FOREIGN KEY (station, part_id) REFERENCES public.results(station, part_id);
ALTER TABLE ONLY public.refused_triggers
    ADD CONSTRAINT refused_triggers_station_fkey FOREIGN KEY (station) REFERENCES public.stations(station);
ALTER TABLE ONLY public.results
    ADD CONSTRAINT results_station_part_id_number_fkey FOREIGN KEY (station, part_id, number) REFERENCES public.begun_parts(station, part_id, number);
\unrestrict eGcEEYTmOXeDcLwJjeTcdmfmfHE62CZRLGpuJGAfdZpF9aBOm48w3Xb8GMm9FCZ
