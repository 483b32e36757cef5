-- Roles of the shared database, each with the least rights that its work needs. The owner of the database executes this
-- script after the tables were created and again after every upgrade. The owner needs the right to create roles
-- (CREATEROLE), unless an administrator has already created the three roles.
--
--   calstation_station  a station: adds and changes runs of its own folders, claims units; deletes no run, reads all
--   calstation_fleet    solves logs again: reads runs, adds solutions, changes the locations of their logs
--   calstation_reader   reads all, for evaluations
--
-- A login of each station is a member of its role: CREATE ROLE line1 LOGIN PASSWORD '...' IN ROLE calstation_station;

DO $$
DECLARE
    name text;
BEGIN
    FOREACH name IN ARRAY ARRAY['calstation_station', 'calstation_fleet', 'calstation_reader'] LOOP
        IF NOT EXISTS (SELECT FROM pg_roles WHERE rolname = name) THEN
            EXECUTE format('CREATE ROLE %I NOLOGIN', name);
        END IF;
        EXECUTE format('GRANT CONNECT ON DATABASE %I TO %I', current_database(), name);
    END LOOP;
    EXECUTE format('REVOKE ALL ON DATABASE %I FROM PUBLIC', current_database());
END $$;

REVOKE ALL ON SCHEMA public FROM PUBLIC;
REVOKE ALL ON ALL TABLES IN SCHEMA public FROM PUBLIC, calstation_station, calstation_fleet, calstation_reader;
GRANT USAGE ON SCHEMA public TO calstation_station, calstation_fleet, calstation_reader;

GRANT SELECT ON alembic_version TO calstation_station, calstation_fleet, calstation_reader;
GRANT SELECT ON outboxes, revisions, runs, log_copies, solutions, versions, locations, trail_heads
    TO calstation_station, calstation_fleet, calstation_reader;

GRANT INSERT, UPDATE ON outboxes, runs, log_copies TO calstation_station;
GRANT UPDATE ON revisions TO calstation_station;
GRANT INSERT ON trail_heads TO calstation_station;
GRANT SELECT, INSERT, UPDATE, DELETE ON claims TO calstation_station;

GRANT INSERT ON solutions, versions TO calstation_fleet;
GRANT INSERT, UPDATE ON locations TO calstation_fleet;
GRANT USAGE ON SEQUENCE solutions_id_seq TO calstation_fleet;

GRANT SELECT ON claims TO calstation_reader;

-- A login may change only outboxes that it has registered or that have no login, and the rows that belong to them.
-- Policies do not apply to the owner of the tables.
DO $$
DECLARE
    name text;
    own text;
BEGIN
    FOREACH name IN ARRAY ARRAY['outboxes', 'runs', 'log_copies', 'claims', 'trail_heads'] LOOP
        own := 'EXISTS (SELECT FROM outboxes WHERE outboxes.id = outbox AND outboxes.login = current_user)';
        IF name = 'outboxes' THEN
            own := 'coalesce(login, current_user) = current_user';
        END IF;
        EXECUTE format('ALTER TABLE %I ENABLE ROW LEVEL SECURITY', name);
        EXECUTE format('DROP POLICY IF EXISTS readable ON %I', name);
        EXECUTE format('DROP POLICY IF EXISTS own ON %I', name);
        EXECUTE format('CREATE POLICY readable ON %I FOR SELECT USING (true)', name);
        EXECUTE format('CREATE POLICY own ON %I TO calstation_station USING (%s)', name, own);
    END LOOP;
END $$;
